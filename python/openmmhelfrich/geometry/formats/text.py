"""Lines of text files, which know their numbers."""

import codecs
import re

import numpy as np
from numpy.typing import NDArray


class Lines:
    """The lines of a text file that are neither empty nor comments.

    Attributes
    ----------
    texts : list of str
        the lines, without comments and blanks at either end
    numbers : list of int
        where each stands in the file, counted from 1
    """

    def __init__(self, content: bytes, comment: str | None = "#", continued: bool = False):
        """Create it from a file's bytes.

        Parameters
        ----------
        content : bytes
            the text, in UTF-8, or in UTF-16 with a byte order mark; a byte that is none is read as a question mark
        comment : str, optional
            what begins a comment
        continued : bool
            whether a line that ends with a backslash goes on in the next
        """
        encoding = "utf-16" if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig"
        text = content.decode(encoding, errors="replace")
        if continued:
            text = re.sub(r"\\\r?\n((?:.*\\\r?\n)*)", lambda found: " " + found[1].replace("\\", " "), text)
        self.texts, self.numbers = [], []
        for number, line in enumerate(text.splitlines(), start=1):
            if comment is not None and comment in line:
                line = line[: line.index(comment)]
            line = line.strip()
            if line:
                self.texts.append(line)
                self.numbers.append(number)

    def __len__(self) -> int:
        return len(self.texts)

    def fault(self, line: int, allowed: str) -> ValueError:
        """Return an error that names a line and what it must be."""
        text = self.texts[line]
        return ValueError(f"line {self.numbers[line]} is '{text[:60]}{'...' * (len(text) > 60)}'; it must be {allowed}")

    def require(self, first: int, count: int, what: str) -> None:
        """Raise a ValueError unless there are so many lines from one on."""
        if len(self) - first < count:
            raise ValueError(f"it is not complete: it ends after {max(len(self) - first, 0)} of {count} {what}")

    def table(self, first: int, count: int, columns: int, kind: type, what: str, skip: int = 0) -> NDArray:
        """Return some columns of lines from one on, a line a row, as an array.

        Parameters
        ----------
        first, count : int
            the first line, and how many
        columns, skip : int
            how many columns, after how many others; what follows is not looked at
        kind : type
            float or int
        what : str
            what the lines are, as errors say
        """
        self.require(first, count, what)
        return self.rows(range(first, first + count), columns, kind, what, skip)

    def rows(self, lines: "range | list[int]", columns: int, kind: type, what: str, skip: int = 0) -> NDArray:
        """Return some columns of some lines; see :meth:`table`."""
        if not lines:
            return np.zeros((0, columns), dtype=kind)
        texts = [self.texts[i] for i in lines]
        try:
            return np.loadtxt(texts, dtype=kind, usecols=range(skip, skip + columns), ndmin=2, comments=None)
        except ValueError:
            for i in lines:
                try:
                    [kind(word) for word in self.texts[i].split()[skip : skip + columns]][columns - 1]
                except (ValueError, IndexError):
                    names = "whole numbers" if kind is int else "numbers"
                    raise self.fault(i, f"{columns} {names}{f' after {skip} words' * (skip > 0)}: {what}") from None
            raise

    def integers(self, line: int, least: int, what: str) -> list[int]:
        """Return the integers of a line, of which there must be a number at least and none negative."""
        try:
            values = [int(word) for word in self.texts[line].split()]
        except ValueError:
            values = []
        if len(values) < least or min(values) < 0:
            raise self.fault(line, what)
        return values
