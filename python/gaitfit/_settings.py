"""What all settings have: checks of their types, and TOML."""

from __future__ import annotations

import difflib
import functools
import json
import os
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints

from . import _gaitfit
from ._arguments import path as named
from ._toml import key, toml

if TYPE_CHECKING:
    from typing import Self
else:
    from ._hints import Self

#: Names of settings in Python that files write otherwise; the same table is NAMES in tools/make_python_config.py.
KEYS = {
    "parameters": "parameter", "numbers": "number", "networks": "network", "lambda_": "lambda", "num_envs": "environments"
}
#: Earlier names of settings, which are taken, too.
EARLIER = {"environments": "num_envs"}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings as a dataclass. ``None`` is the default of gaitfit, which may depend on other settings.

    A value of a wrong type is a ``TypeError``, and one that is not among the choices a ``ValueError``; both name the setting.
    ``dataclasses.replace`` makes changed copies.

    >>> gaitfit.config.Fit(robot="go2.xml", optimizer=gaitfit.config.Optimizer(seeds=3)).to_dict()
    {'robot': 'go2.xml', 'optimizer': {'seeds': 3}}
    """

    def __post_init__(self) -> None:
        hints = get_type_hints(type(self))
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, str) and one.name == "costs":
                # One cost is a list of one, as in gaitfit.fit.
                value = [value]
                object.__setattr__(self, one.name, value)
            wrong = None if value is None else _wrong(hints[one.name], value)
            if wrong is not None:
                kind, must = wrong
                raise kind(f"{one.name} of {type(self).__name__} is {value!r}; it must be {must}")

    def to_dict(self) -> dict[str, Any]:
        """The settings that are not ``None``, with the names of a configuration file."""
        given = {KEYS.get(one.name, one.name): _plain(getattr(self, one.name)) for one in fields(self)}
        return {name: value for name, value in given.items() if value is not None}

    def to_toml(self) -> str:
        """The settings that are not ``None``, as a configuration file for the program."""
        return "".join(table_lines("", self.to_dict()))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """Settings with the names of a configuration file. Raises ``ValueError`` for a name that there is not."""
        settings: Self = _decoded(cls, document, "")
        return settings

    @classmethod
    def from_toml(cls, text: str) -> Self:
        """The settings of a configuration's text. Raises ``ValueError`` with line and column for wrong TOML, and for a
        name that there is not."""
        return cls.from_dict(json.loads(_gaitfit.read_toml(text)))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """The settings of the configuration file at ``path``. Relative paths in it stay as they are.

        Raises ``FileNotFoundError`` if there is no file, and ``ValueError`` as :meth:`from_toml`.
        """
        file = Path(named("path", path))
        try:
            return cls.from_toml(file.read_text(encoding="utf-8"))
        except ValueError as wrong:
            raise ValueError(f"{file}: {wrong}") from wrong


def helpful(kind: type[Settings]) -> None:
    """Has a class of settings name what was meant where there is no such setting."""
    made: Callable[..., None] = kind.__init__
    names = [one.name for one in fields(kind)]

    @functools.wraps(made)
    def init(self: Settings, *arguments: Any, **given: Any) -> None:
        given = {name if name in names else EARLIER.get(name, name): value for name, value in given.items()}
        unknown = next((name for name in given if name not in names), None)
        if unknown is not None:
            raise TypeError(f"{kind.__name__} has no setting {unknown!r}{meant(unknown, names)}")
        made(self, *arguments, **given)

    setattr(kind, "__init__", init)


def meant(name: object, names: Iterable[str]) -> str:
    """What is near to a name, for the end of a message."""
    near = difflib.get_close_matches(str(name), names, 1)
    return f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(names)}"


def _wrong(hint: Any, value: Any) -> tuple[type[TypeError] | type[ValueError], str] | None:
    """What is wrong with a value: the kind of error, and what it must be."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        found = [_wrong(one, value) for one in arguments if one is not type(None)]
        if any(one is None for one in found):
            return None
        choice = next((one for one in found if one is not None and one[0] is ValueError), None)
        return choice or (TypeError, " or ".join(dict.fromkeys(one[1] for one in found if one is not None)))
    if origin is Literal:
        if value in arguments:
            return None
        near = difflib.get_close_matches(value, [str(one) for one in arguments], 1) if isinstance(value, str) else []
        text = " or ".join(repr(one) for one in arguments) + (f"; did you mean {near[0]!r}?" if near else "")
        return (ValueError if isinstance(value, str) else TypeError), text
    if hint is bool:
        return None if isinstance(value, bool) else (TypeError, "True or False")
    if hint is int:
        return None if hasattr(value, "__index__") and not isinstance(value, bool) else (TypeError, "a whole number")
    if hint is float:
        return None if _is_number(value) else (TypeError, "a number")
    if hint is str:
        return None if isinstance(value, str) else (TypeError, "a text")
    if origin is os.PathLike or hint is os.PathLike:
        return None if isinstance(value, os.PathLike) else (TypeError, "a path")
    if origin is tuple:
        return _wrong_items(value, arguments, f"{len(arguments)} numbers" if arguments[0] is float else f"{len(arguments)} texts")
    if origin is Mapping:
        if not isinstance(value, Mapping):
            return TypeError, "a dict"
        return next((one for one in (_wrong(arguments[1], item) for item in value.values()) if one), None)
    if origin is Sequence:
        if isinstance(value, (str, bytes, Mapping)) or not hasattr(value, "__len__"):
            return TypeError, "a list"
        found_item = next((one for one in (_wrong(arguments[0], item) for item in value) if one), None)
        return None if found_item is None else (found_item[0], f"a list, each {found_item[1]}")
    if isinstance(hint, type):
        return None if isinstance(value, hint) else (TypeError, f"a gaitfit.config.{hint.__name__}")
    return None


def _wrong_items(value: Any, kinds: tuple[Any, ...], must: str) -> tuple[type[TypeError] | type[ValueError], str] | None:
    if isinstance(value, (str, bytes, Mapping)) or not hasattr(value, "__len__") or len(value) != len(kinds):
        return TypeError, must
    return next(((TypeError, must) for kind, item in zip(kinds, value) if _wrong(kind, item)), None)


def _is_number(value: Any) -> bool:
    if isinstance(value, (bool, str, bytes)) or getattr(value, "shape", ()) != ():
        return False
    return hasattr(value, "__float__") or hasattr(value, "__index__")


def _plain(value: Any) -> Any:
    if isinstance(value, Settings):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value


def table_lines(place: str, table: Mapping[str, Any]) -> list[str]:
    """A table of a file: first its values, then its tables and lists of tables."""
    inner = {name: value for name, value in table.items() if isinstance(value, dict)}
    several = {name: value for name, value in table.items() if _is_tables(value)}
    lines = [f"{key(name)} = {toml(value)}\n" for name, value in table.items() if name not in inner and name not in several]
    for name, value in inner.items():
        where = f"{place}{key(name)}"
        lines += [f"\n[{where}]\n", *table_lines(f"{where}.", value)]
    for name, values in several.items():
        where = f"{place}{key(name)}"
        for value in values:
            lines += [f"\n[[{where}]]\n", *table_lines(f"{where}.", value)]
    return lines


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _decoded(kind: Any, document: Mapping[str, Any], place: str) -> Any:
    """Settings of a table of a file; ``place`` is its name for errors."""
    if not isinstance(document, Mapping):
        raise ValueError(f"{place.rstrip('.') or 'the configuration'} is {document!r}; it must be a table")
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    names = {KEYS.get(one.name, one.name): one.name for one in fields(kind)}
    for name, value in document.items():
        if name not in names:
            raise ValueError(f"there is no setting {place}{name}{meant(name, names)}")
        values[names[name]] = _value(hints[names[name]], value, f"{place}{name}.")
    missing = [one.name for one in fields(kind) if one.kw_only is False and one.name not in values]
    if missing:
        raise ValueError(f"{place.rstrip('.')} needs {missing[0]}")
    return kind(**values)


def _value(hint: Any, value: Any, place: str) -> Any:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        for one in arguments:
            table = get_origin(one) is Mapping or (isinstance(one, type) and issubclass(one, Settings))
            several = get_origin(one) in (Sequence, tuple)
            if (table and isinstance(value, Mapping)) or (several and isinstance(value, list)):
                return _value(one, value, place)
        return value
    if isinstance(hint, type) and issubclass(hint, Settings):
        return _decoded(hint, value, place)
    if origin is Mapping and isinstance(value, Mapping):
        return {name: _value(arguments[1], one, f"{place}{name}.") for name, one in value.items()}
    if origin is Sequence and isinstance(value, list):
        return [_value(arguments[0], one, f"{place}{number}.") for number, one in enumerate(value)]
    if origin is tuple and isinstance(value, list):
        return tuple(value)
    return value
