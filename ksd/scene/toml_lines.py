"""Line numbers of mistakes in a scene file: the TOML parser gives none, so tables and keys are searched in the text."""

from __future__ import annotations

import re

_HEADER = re.compile(r"""\s*(\[\[?)([\w.\-"' ]+)\]\]?\s*(?:\#.*)?""")
_LOCATION = re.compile(
    r"(?:, \[\[?(?P<path>[^\]]+)\]\]?(?: (?P<row>\d+))?(?:, \[(?P<part>[^\]]+)\])?)?"
    r"(?: = |: (?:key '(?P<unknown>[^']+)' is unknown|(?P<key>\w+)(?:\S* = |: link '))?)"
)


class LineNumbers:
    """Line numbers of the tables and keys in the text of a file."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.lines = name, text.splitlines()
        self.headers: list[tuple[str, int]] = [("", 0)]
        for number, line in enumerate(self.lines, 1):
            match = _HEADER.fullmatch(line)
            if match:
                path = ".".join(part.strip(" \"'") for part in match[2].split("."))
                self.headers.append((path, number))

    def add_to(self, message: str) -> str:
        """The message "file, [table]: ..." as "file, line 12, [table]: ...", or unchanged if the line is not found."""
        match = _LOCATION.match(message, len(self.name))
        number = self._find_line(match) if match and message.startswith(self.name) else 0
        if not number:
            return message
        return f"{self.name}, line {number}{message[len(self.name) :]}"

    def _find_line(self, match: re.Match[str]) -> int:
        """The line of the key, else of the header of its table; 0 if neither is found."""
        path, row = match["path"] or "", int(match["row"] or 1)
        tables = [k for k, (header, _) in enumerate(self.headers) if header == path]
        if len(tables) < row:
            return 0
        index = tables[row - 1]
        last = tables[row] if row < len(tables) else len(self.headers)
        parts = [k for k in range(index, last) if self.headers[k][0] == match["part"]]
        index = parts[0] if parts else index
        start = self.headers[index][1]
        end = self.headers[index + 1][1] - 1 if index + 1 < len(self.headers) else len(self.lines)
        key = match["unknown"] or match["key"]
        if key:
            assignment = re.compile(rf"""\s*["']?{re.escape(key)}["']?\s*=""")
            for number in range(start + 1, end + 1):
                if assignment.match(self.lines[number - 1]):
                    return number
        return start
