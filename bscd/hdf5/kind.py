"""The kinds of files, and where all of them say what they are and how their writing ended."""

from __future__ import annotations

from dataclasses import dataclass

ENTRY = "entry"
RECORDING = "entry/recording"


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of file: what it is called, what /entry/definition says, and what messages advise.

    ``source`` names files of this kind ("give ..."); ``restore`` is what to do about a damaged one, ``for_folder``
    about a folder in its place (with ``{path}``); ``keep`` says why one is never overwritten, ``after_crash`` what to
    do with one whose writer was killed, ``when_cut_off`` with one whose end is missing (with ``{path}``; empty: the
    same as with a damaged one).
    """

    name: str
    definition: str
    version: str
    source: str
    restore: str
    for_folder: str
    keep: str
    after_crash: str
    when_cut_off: str = ""
