"""A person's defaults: ``config.toml`` in the user's folder, and ``rotdrift.toml`` in that of a project.

The nearer one counts: an option on the command line, then the ``rotdrift.toml`` of this folder or the next one above
that has it, then the user's file, then the program's own default. Paths are relative to the file they stand in.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from host.command_line.parser import nearest
from host.errors import FileError, UsageError, unreadable, unwritable
from host.text import plain

PROJECT_FILE = "rotdrift.toml"
MAX_BYTES = 100_000
Value: TypeAlias = str | bool | Path


@dataclass(frozen=True, slots=True)
class Setting:
    """One thing that has a default."""

    name: str
    purpose: str
    built_in: str
    """What holds where nobody chose."""
    choices: tuple[str, ...] = ()
    is_path: bool = False
    is_switch: bool = False

    def read(self, value: object, where: str, folder: Path) -> Value:
        """Return a value as the option has it.

        Raises
        ------
        UsageError
            Of another type, or none of the choices.
        """
        if self.is_switch:
            words = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
            found = value if isinstance(value, bool) else words.get(str(value).lower())
            if found is None:
                raise UsageError(f"{where}: {self.name} is true or false, not {plain(str(value), 60)!r}")
            return found
        if not isinstance(value, str) or not value:
            raise UsageError(f"{where}: {self.name} is a text, not {plain(str(value), 60)!r}", f'{self.name} = "..."')
        if self.choices and value not in self.choices:
            raise UsageError(f"{where}: {self.name} is one of {', '.join(self.choices)}, not {plain(value, 60)!r}")
        return folder / Path(value).expanduser() if self.is_path else value


SETTINGS = {
    setting.name: setting
    for setting in (
        Setting("link", "link to the object, for capture and baseline", "none"),
        Setting("folder", "where capture writes recordings without --out", "rotdrift-trials", is_path=True),
        Setting("baseline", "static baseline of the sensor, for capture", "none", is_path=True),
        Setting("hand", "card of the hand, for recordings that have none beside them", "none", is_path=True),
        Setting("theme", "background of the terminal", "auto", choices=("auto", "dark", "light")),
        Setting("ascii", "draw with ASCII only", "false", is_switch=True),
    )
}

DEFAULTS_OF = {
    "capture": {name: name for name in ("link", "folder", "baseline", "theme", "ascii")},
    "baseline": {"link": "source"},
    "replay": {name: name for name in ("theme", "ascii")},
    "report": {"hand": "hand"},
}
"""Command -> setting -> the ``dest`` of the argument that it is the default of.

No baseline for ``score`` and ``report``: it belongs to one sensor, and they read recordings of any.
"""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A setting that somebody chose."""

    value: Value
    source: Path
    """The file it stands in."""


def user_file() -> Path:
    """Return where the user's own defaults are, on every platform in its own place."""
    from platformdirs import user_config_path

    return user_config_path("rotdrift", appauthor=False) / "config.toml"


def project_file(folder: Path | None = None) -> Path | None:
    """Return the ``rotdrift.toml`` of a folder, or of the next one above it; None where there is none."""
    folder = (folder or Path()).absolute()
    return next((path for at in (folder, *folder.parents) if (path := at / PROJECT_FILE).is_file()), None)


def chosen_settings(folder: Path | None = None) -> dict[str, Chosen]:
    """Return the settings that user or project chose, the nearer one of each.

    Raises
    ------
    FileError
        A file cannot be read or is not TOML.
    UsageError
        A key or a value that does not exist.
    """
    chosen: dict[str, Chosen] = {}
    project = project_file(folder)
    for path in (user_file(), project):
        if path is not None and path.is_file():
            values = _read(path)
            for name, value in values.items():
                setting = setting_of(name, str(path))
                chosen[name] = Chosen(setting.read(value, str(path), path.parent), path)
    return chosen


def defaults_for(command: str) -> dict[str, Value]:
    """Return what user and project chose for the arguments of a command, by ``dest``."""
    arguments = DEFAULTS_OF[command]
    return {arguments[name]: found.value for name, found in chosen_settings().items() if name in arguments}


def change(path: Path, name: str, value: str | None) -> None:
    """Set one setting in a file, or take it out (None); the others stay.

    Raises
    ------
    FileError
        The file cannot be read or written.
    UsageError
        No such setting, or a value that it cannot have.
    """
    import tomli_w

    setting = setting_of(name)
    values = _read(path) if path.is_file() else {}
    if value is None:
        values.pop(name, None)
    else:
        found = setting.read(value, "the value", Path())
        values[name] = found if isinstance(found, bool) else _as_written(setting, value)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(tomli_w.dumps(values), encoding="utf-8")
    except OSError as error:
        raise unwritable(path, error) from error


def _as_written(setting: Setting, value: str) -> str:
    """Return a value as it goes into a file: paths in full, as they were meant in the folder of the moment."""
    return str(Path(value).expanduser().absolute()) if setting.is_path else value


def setting_of(name: str, where: str = "") -> Setting:
    """Return a setting by its name; ``where`` is the file that it was found in.

    Raises
    ------
    UsageError
        There is none of that name.
    """
    if name not in SETTINGS:
        near = nearest(name, SETTINGS)
        remedy = f"there are {', '.join(SETTINGS)}" if near is None else f"did you mean {near}?"
        raise UsageError(f"{where and where + ': '}there is no setting {plain(name, 60)!r}", remedy)
    return SETTINGS[name]


def _read(path: Path) -> dict[str, object]:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise unreadable(path, error) from error
    if len(data) > MAX_BYTES:
        raise FileError(f"{path} is larger than {MAX_BYTES} bytes: it is not a configuration")
    try:
        return tomllib.loads(data.decode())
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path} is not TOML ({plain(str(error), 200)})", "correct that line") from error
