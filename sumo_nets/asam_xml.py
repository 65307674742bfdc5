"""The XML files of ASAM standards, which come from anywhere, opened with care."""

from pathlib import Path
from xml.etree import ElementTree as ET

from sumo_nets.errors import NetworkError


def root_of(path: Path, standard: str, largest_bytes: int) -> ET.Element:
    """The root of an XML file, whatever its tag; NetworkError, one line, where it cannot be read or is none.

    standard: its name, for what is said of files that are no plain XML
    """
    try:
        if path.stat().st_size > largest_bytes:
            raise NetworkError(f"{path}: more than {largest_bytes >> 20} MiB")
        text = path.read_bytes()
    except OSError as error:
        raise NetworkError(f"{path}: cannot be read ({error.strerror})") from error
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise NetworkError(f"{path}: declares entities of its own; expected plain {standard} XML")
    try:
        return ET.fromstring(text)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise NetworkError(f"{path}: not XML ({error})") from error
