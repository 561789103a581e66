"""XML of recordings: elements by their local names, without entities."""

from pathlib import Path
from xml.etree import ElementTree

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_bytes, reason

LARGEST_XML = 512 * 1024**2
"""Bytes; its elements take some ten times as much memory."""


def read_xml(path: Path) -> ElementTree.Element:
    """Root of an XML file, its names without name spaces.

    Raises
    ------
    InputError
        As `read_bytes`; no XML in UTF-8; a document type, whose entities could unpack to any size.
    """
    data = read_bytes(path, LARGEST_XML)
    if b"\0" in data or b"<!DOCTYPE" in data.upper():
        raise InputError(f"{path_text(path)}: is no UTF-8 XML without a document type; export it again")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, RecursionError, LookupError, ValueError) as error:
        raise InputError(f"{path_text(path)}: is not XML ({reason(error)}); export it again") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root
