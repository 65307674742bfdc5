"""The published schemas are those of the types."""

from service.remote.api.routes import wire_types
from service.remote.api.schemas import FOLDER, published, text_of


def test_files_are_up_to_date() -> None:
    stale = [n for n, kind in wire_types().items() if published()[n].decode() != text_of(kind)]
    assert not stale, "run `python -m service.remote.api.schemas`"


def test_no_file_is_left_over() -> None:
    assert sorted(f.name for f in FOLDER.iterdir()) == sorted(f"{name}.json" for name in wire_types())
