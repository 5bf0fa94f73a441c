"""The suite's parameters: frozen dataclasses in the rooms, flat dotted names outside.

Each room states its options as a frozen dataclass of `option` fields. From it come the ROS
parameters of the nodes (with descriptors) and the reading of parameter files by the offline verbs,
so both know the same names, the same ranges and the same refusals.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any

#: Begins the names of ROS's own parameters of a topic's quality of service.
QOS_OVERRIDES = 'qos_overrides.'
#: Stands between camera and control in the names of what a camera has besides its options.
CONTROLS = '.controls.'


class ParameterError(ValueError):
    """A parameter that is unknown, of the wrong type or out of range."""


class UnfinishedError(ParameterError):
    """Values that do not fit together yet: another one is missing, or has to change as well.

    At the start that is an error like others; a running node waits for the rest.
    """


def option(
    default: Any,
    description: str,
    unit: str = '',
    limits: tuple[float, float] | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Any:
    """A field of an options dataclass: default, meaning, unit, lowest and highest value, choices.

    A `read_only` one cannot change while a node runs.
    """
    metadata = {
        'description': description,
        'unit': unit,
        'range': limits,
        'choices': choices,
        'read_only': read_only,
    }
    return dataclasses.field(default=default, metadata=metadata)


def check_options(options: Any, error: type[ValueError]) -> None:
    """Refuse what lies outside of the choices and ranges that an options dataclass states itself.

    For its `__post_init__`, so that options made in code are held to what parameter files are.

    Raises:
        error: a value of another kind, not finite, out of range, or not among the choices.
    """
    for field in dataclasses.fields(options):
        value, metadata = getattr(options, field.name), field.metadata
        if metadata.get('choices'):
            if value not in metadata['choices']:
                known = ', '.join(metadata['choices'])
                msg = f'option {field.name} is {value!r}; it must be one of {known}'
                raise error(msg)
        elif isinstance(field.default, bool):
            if not isinstance(value, bool):
                msg = f'option {field.name} is {value!r}; it must be true or false'
                raise error(msg)
        elif metadata.get('range') and isinstance(field.default, (int, float)):
            whole = isinstance(field.default, int)
            good = isinstance(value, int if whole else (int, float))
            if not good or isinstance(value, bool) or not math.isfinite(value):
                wanted = 'a whole number' if whole else 'a finite number'
                msg = f'option {field.name} is {value!r}; it must be {wanted}'
                raise error(msg)
            lowest, highest = metadata['range']
            if not lowest <= value <= highest:
                unit = f' {metadata["unit"]}' if metadata.get('unit') else ''
                msg = (
                    f'option {field.name} is {value}; it must be from {lowest} to {highest}{unit}'
                )
                raise error(msg)


@dataclasses.dataclass(frozen=True)
class ParameterSpec:
    """One parameter as a user sees it.

    `kind` is bool, int, float, str, or tuple, whose items are of type `element`; `default` is None
    where the parameter may be left unset.
    """

    name: str
    kind: type
    element: type | None
    default: Any
    description: str
    limits: tuple[float, float] | None
    choices: tuple[str, ...]
    read_only: bool


def specs_of(options_type: type, prefix: str = '') -> dict[str, ParameterSpec]:
    """Parameters of an options dataclass by dotted name; nested dataclasses give the dots."""
    specs: dict[str, ParameterSpec] = {}
    hints = typing.get_type_hints(options_type)
    for field in dataclasses.fields(options_type):
        hint = _without_none(hints[field.name])
        name = prefix + field.name
        if dataclasses.is_dataclass(hint):
            specs.update(specs_of(typing.cast(type, hint), f'{name}.'))
            continue
        is_sequence = typing.get_origin(hint) is tuple
        specs[name] = ParameterSpec(
            name=name,
            kind=tuple if is_sequence else hint,
            element=typing.get_args(hint)[0] if is_sequence else None,
            default=_default_of(field),
            description=_describe(field.metadata),
            limits=field.metadata.get('range'),
            choices=tuple(field.metadata.get('choices', ())),
            read_only=bool(field.metadata.get('read_only', False)),
        )
    return specs


def build(options_type: type, values: Mapping[str, Any], prefix: str = '') -> Any:
    """Options of the given type from flat dotted names.

    Names that are absent, or None, keep their default.

    Raises:
        ParameterError: a name is unknown, a value has the wrong type or is out of range.
        The room's own error: the options do not fit together.
    """
    specs = specs_of(options_type, prefix)
    refuse_unknown(values, specs)
    return _build(options_type, values, specs, prefix)


def refuse_unknown(values: Iterable[str], known: Iterable[str]) -> None:
    """Refuse the first name that is not known, with the nearest one that is.

    Raises:
        ParameterError: a name is unknown.
    """
    known = list(known)
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f'did you mean {near[0]!r}?' if near else f'known: {", ".join(sorted(known))}'
            msg = f'unknown parameter {name!r}: {hint}'
            raise ParameterError(msg)


def _build(
    options_type: type, values: Mapping[str, Any], specs: Mapping[str, ParameterSpec], prefix: str
) -> Any:
    hints = typing.get_type_hints(options_type)
    arguments: dict[str, Any] = {}
    for field in dataclasses.fields(options_type):
        hint = _without_none(hints[field.name])
        name = prefix + field.name
        if dataclasses.is_dataclass(hint):
            arguments[field.name] = _build(typing.cast(type, hint), values, specs, f'{name}.')
        elif values.get(name) is not None:
            arguments[field.name] = checked(specs[name], values[name])
    return options_type(**arguments)


def checked(spec: ParameterSpec, value: Any) -> Any:
    """The value as the parameter's own type.

    Raises:
        ParameterError: wrong type, not finite, out of range or not among the choices.
    """
    if spec.kind is tuple:
        if isinstance(value, (str, bytes)) or not hasattr(value, '__iter__'):
            msg = f'parameter {spec.name!r} is {value!r}: give a list'
            raise ParameterError(msg)
        return tuple(_scalar(spec, typing.cast(type, spec.element), item) for item in value)
    return _scalar(spec, spec.kind, value)


def _scalar(spec: ParameterSpec, kind: type, value: Any) -> Any:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    accepted = is_number if kind is float else isinstance(value, kind)
    if kind is int and isinstance(value, bool):
        accepted = False
    if not accepted:
        msg = (
            f'parameter {spec.name!r} is {value!r}, of type {type(value).__name__}: '
            f'give a {kind.__name__}'
        )
        raise ParameterError(msg)
    if kind is float and not math.isfinite(value):
        msg = f'parameter {spec.name!r} is {value!r}: give a finite number'
        raise ParameterError(msg)
    if spec.limits is not None and not spec.limits[0] <= value <= spec.limits[1]:
        msg = (
            f'parameter {spec.name!r} is {value!r}: '
            f'it must lie in {spec.limits[0]} .. {spec.limits[1]}'
        )
        raise ParameterError(msg)
    if spec.choices and value not in spec.choices:
        msg = f'parameter {spec.name!r} is {value!r}: choose one of {", ".join(spec.choices)}'
        raise ParameterError(msg)
    return kind(value)


def _default_of(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return None


def _describe(metadata: Mapping[str, Any]) -> str:
    text = str(metadata.get('description', ''))
    unit = metadata.get('unit')
    return f'{text} [{unit}]' if unit else text


def _without_none(hint: Any) -> Any:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        kinds = [kind for kind in typing.get_args(hint) if kind is not type(None)]
        if len(kinds) == 1:
            return kinds[0]
    if typing.get_origin(hint) is typing.Literal:
        return str
    return hint
