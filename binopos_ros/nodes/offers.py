"""Quality of service between bags and topics: what to offer, what to ask for, what was offered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from binopos_ros.bag.qos import INFINITE_NS, Qos, played_as

#: Enough for a second of images and centroids while a subscriber is held up.
OFFERED_DEPTH = 30
#: Three seconds of images while the recorder is held up.
REQUESTED_DEPTH = 100


def profile_offered(recorded: Sequence[Qos]) -> QoSProfile:
    """What a player offers of what was recorded so."""
    reliable, latched = played_as(recorded)
    return _profile(OFFERED_DEPTH, reliable, latched)


class Request(NamedTuple):
    """What a subscription asks for; it hears publishers that offer at least that."""

    reliable: bool
    latched: bool

    def profile(self) -> QoSProfile:
        """The profile to subscribe with."""
        return _profile(REQUESTED_DEPTH, self.reliable, self.latched)


def requests_for(offers: Iterable[QoSProfile]) -> set[Request]:
    """What to ask for to get from every publisher all that it offers."""
    return {
        Request(
            offer.reliability == QoSReliabilityPolicy.RELIABLE,
            offer.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL,
        )
        for offer in offers
    }


def offer_of(profile: QoSProfile) -> Qos:
    """A publisher's profile as a bag holds it."""
    return Qos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
        depth=profile.depth,
        liveliness=profile.liveliness.name.lower(),
        deadline_ns=_duration(profile.deadline.nanoseconds),
        lifespan_ns=_duration(profile.lifespan.nanoseconds),
        liveliness_lease_ns=_duration(profile.liveliness_lease_duration.nanoseconds),
    )


def _profile(depth: int, reliable: bool, kept: bool) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=(
            QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT
        ),
        durability=(QoSDurabilityPolicy.TRANSIENT_LOCAL if kept else QoSDurabilityPolicy.VOLATILE),
    )


def _duration(nanoseconds: int) -> int:
    return nanoseconds if 0 < nanoseconds < INFINITE_NS else INFINITE_NS
