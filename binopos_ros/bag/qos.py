"""The quality of service that a topic's publishers offered, as rosbag2 writes it down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from binopos_ros import plain_yaml

#: What `ros2 bag` prints for an unlimited duration.
INFINITE_NS = 2**63 - 1

# Numbers of rmw's enums, which bags up to metadata version 8 hold instead of words.
_WORDS = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': (
        'system_default',
        'transient_local',
        'volatile',
        'unknown',
        'best_available',
    ),
    'liveliness': (
        'system_default',
        'automatic',
        'manual_by_node',
        'manual_by_topic',
        'unknown',
        'best_available',
    ),
}


@dataclass(frozen=True)
class Qos:
    """One publisher's offer; durations in nanoseconds."""

    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'
    depth: int = 10
    liveliness: str = 'automatic'
    deadline_ns: int = INFINITE_NS
    lifespan_ns: int = INFINITE_NS
    liveliness_lease_ns: int = INFINITE_NS


def played_as(recorded: Sequence[Qos]) -> tuple[bool, bool]:
    """Whether a topic is played reliably, and whether latched.

    As its publishers offered where they agreed; reliable and volatile elsewhere.
    """
    offers = {(offer.reliability, offer.durability) for offer in recorded}
    reliability, durability = offers.pop() if len(offers) == 1 else ('reliable', 'volatile')
    return reliability != 'best_effort', durability == 'transient_local'


def parse_qos(text: str) -> list[Qos]:
    """Offers out of a channel's `offered_qos_profiles`; [] where the text says nothing usable.

    Both spellings are read: numbers (up to metadata version 8) and words (from version 9).
    A bag whose quality of service is unreadable still plays, with the default.
    """
    try:
        entries = plain_yaml.load(text) if text else None
        return [_from_entry(entry) for entry in entries or []]
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):
        return []


def format_qos(offers: Sequence[Qos], indent: str = '') -> str:
    """Offers as YAML in the words of metadata version 9; `[]` where there are none."""
    if not offers:
        return '[]'
    lines: list[str] = []
    for offer in offers:
        lines += [
            f'- history: {offer.history}',
            f'  depth: {offer.depth}',
            f'  reliability: {offer.reliability}',
            f'  durability: {offer.durability}',
            *_duration_lines('deadline', offer.deadline_ns),
            *_duration_lines('lifespan', offer.lifespan_ns),
            f'  liveliness: {offer.liveliness}',
            *_duration_lines('liveliness_lease_duration', offer.liveliness_lease_ns),
            '  avoid_ros_namespace_conventions: false',
        ]
    return f'\n{indent}'.join(lines)


def _duration_lines(name: str, nanoseconds: int) -> list[str]:
    seconds, rest = divmod(nanoseconds, 10**9)
    return [f'  {name}:', f'    sec: {seconds}', f'    nsec: {rest}']


def _from_entry(entry: dict[str, Any]) -> Qos:
    return Qos(
        reliability=_word('reliability', entry.get('reliability', 1)),
        durability=_word('durability', entry.get('durability', 2)),
        history=_word('history', entry.get('history', 1)),
        depth=max(0, int(entry.get('depth', 10))),
        liveliness=_word('liveliness', entry.get('liveliness', 1)),
        deadline_ns=_duration(entry.get('deadline')),
        lifespan_ns=_duration(entry.get('lifespan')),
        liveliness_lease_ns=_duration(entry.get('liveliness_lease_duration')),
    )


def _word(policy: str, value: int | str) -> str:
    words = _WORDS[policy]
    if isinstance(value, int):
        return words[value] if 0 <= value < len(words) else 'unknown'
    return value if value in words else 'unknown'


def _duration(value: dict[str, int] | None) -> int:
    if value is None:
        return INFINITE_NS
    seconds, nanoseconds = int(value['sec']), int(value['nsec'])
    # rmw says "unspecified" by zero; Foxy's middlewares said "for ever" by 2^31 - 1 seconds.
    if (seconds, nanoseconds) == (0, 0) or seconds >= 2**31 - 1:
        return INFINITE_NS
    return seconds * 10**9 + nanoseconds
