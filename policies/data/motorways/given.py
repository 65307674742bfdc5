"""Columns of a table of others, checked value by value: a fault is told with its line and column."""

from pathlib import Path

import polars as pl

from policies.data.ngsim_schema import FormatError

TRUTHS = {"true": 1.0, "false": 0.0, "True": 1.0, "False": 0.0}


def columns(path: Path, numbers: tuple[str, ...], words: tuple[str, ...] = ()) -> pl.DataFrame:
    """The columns `numbers` as float64, finite (true and false as 1 and 0), and `words` as text, of a CSV file.

    Raises FormatError where a column or a value is missing, or a value is no number.
    """
    try:
        table = pl.read_csv(path, infer_schema=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise FormatError(
            path, f"a table that cannot be read ({reason})", "a whole CSV file with commas"
        ) from error
    missing = [name for name in (*numbers, *words) if name not in table.columns]
    if missing:
        raise FormatError(path, f"no column {missing[0]}", f"the columns {', '.join((*numbers, *words))}", 1)
    if not table.height:
        raise FormatError(path, "no rows", "a header and rows")
    table = table.select(*numbers, *words)
    read = table.with_columns(
        pl.col(name).str.strip_chars().replace(TRUTHS).cast(pl.Float64, strict=False) for name in numbers
    )
    for name in (*numbers, *words):
        sound = read[name].is_finite().fill_null(False) if name in numbers else read[name].is_not_null()
        if not sound.all():
            row = int(sound.arg_min() or 0)
            wanted = "a finite number" if name in numbers else "a value"
            raise FormatError(path, repr(table[name][row]), wanted, row + 2, name)
    return read


def beside(path: Path, ending: str, other: str) -> Path:
    """The file that belongs to a file NAME`ending`, called NAME`other`; FormatError where it is not there."""
    found = path.with_name(path.name.removesuffix(ending) + other)
    if not path.name.endswith(ending) or not found.is_file():
        raise FormatError(
            path,
            f"no {found.name if path.name.endswith(ending) else 'NAME' + other} beside it",
            f"the publisher's files NAME{ending} and NAME{other} in one folder",
        )
    return found
