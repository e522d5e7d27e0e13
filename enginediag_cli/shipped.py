"""Places of the engines, faults, flights and recorders that come with the program."""

from __future__ import annotations

from pathlib import Path

from enginediag_cli.errors import DataError

INSTALLED = Path("share", "enginediag", "configs")


def shipped(name: str) -> Path:
    """The shipped file of this name, such as "turbofan.yaml", "faults/hpc_fouling.yaml" or "configs/turbofan.yaml".

    Taken from the checkout that the package runs in, else from where the installation put it. Raises DataError
    that names the shipped files closest to it, or the places that were searched.
    """
    folder = shipped_folder()
    path = folder / name.removeprefix("configs/")
    if path.is_file() and path.resolve().is_relative_to(folder.resolve()):
        return path
    from difflib import get_close_matches

    known = [file.relative_to(folder).as_posix() for file in sorted(folder.rglob("*.yaml"))]
    near = get_close_matches(name, known) or [file for file in known if Path(file).name == Path(name).name]
    hint = f"did you mean {' or '.join(near)}?" if near else f"they lie in {folder}"
    raise DataError(f"no file {name!r} comes with enginediag; {hint}")


def own_or_shipped(name: str | Path) -> Path:
    """The file of this name, or one that comes with the program where there is none in the working folder. Raises
    DataError."""
    import os

    path = Path(name)
    if os.path.lexists(path) or path.is_absolute():
        return path
    try:
        return shipped(str(name))
    except DataError as error:
        raise DataError(f"there is no file {str(name)!r} here, and {error}") from None


def shipped_folder() -> Path:
    """The folder of the shipped files. Raises DataError when the installation has none."""
    places = _places()
    for folder in places:
        if folder.is_dir():
            return folder
    raise DataError(f"the engines that come with enginediag are not installed; looked in {', '.join(map(str, places))}")


def _places() -> list[Path]:
    import sysconfig

    checkout = Path(__file__).resolve().parents[1]
    # site-packages could hold somebody else's `configs`; a checkout is known by its pyproject.toml
    beside = [checkout / "configs"] if (checkout / "pyproject.toml").is_file() else []
    schemes = (sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user"))
    return beside + [Path(sysconfig.get_path("data", scheme)) / INSTALLED for scheme in schemes]
