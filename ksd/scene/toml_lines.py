"""On which line of a scene file a mistake is: tables and keys found again in its text, as the parser does not tell."""

from __future__ import annotations

import re

_HEADER = re.compile(r"""\s*(\[\[?)([\w.\-"' ]+)\]\]?\s*(?:\#.*)?""")
_LOCATION = re.compile(
    r"(?:, \[\[?(?P<path>[^\]]+)\]\]?(?: (?P<row>\d+))?(?:, \[(?P<part>[^\]]+)\])?)?"
    r"(?: = |: (?:key '(?P<unknown>[^']+)' is unknown|(?P<key>\w+)(?:\S* = |: link '))?)"
)


class LineNumbers:
    """The lines of a file; `at` says "line 12" into a sentence that names its table and key, where they are found."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.lines = name, text.splitlines()
        self.headers: list[tuple[str, int]] = [("", 0)]
        for number, line in enumerate(self.lines, 1):
            match = _HEADER.fullmatch(line)
            if match:
                path = ".".join(part.strip(" \"'") for part in match[2].split("."))
                self.headers.append((path, number))

    def at(self, sentence: str) -> str:
        """The sentence, "file, [table]: ...", as "file, line 12, [table]: ..."; as it is where the place is not found."""
        match = _LOCATION.match(sentence, len(self.name))
        number = self._line(match) if match and sentence.startswith(self.name) else 0
        if not number:
            return sentence
        return f"{self.name}, line {number}{sentence[len(self.name) :]}"

    def _line(self, match: re.Match[str]) -> int:
        """The line of the key, else of the head of its table; 0 where it is not found."""
        path, row = match["path"] or "", int(match["row"] or 1)
        found = [k for k, (head, _) in enumerate(self.headers) if head == path]
        if len(found) < row:
            return 0
        index = found[row - 1]
        last = found[row] if row < len(found) else len(self.headers)
        parts = [k for k in range(index, last) if self.headers[k][0] == match["part"]]
        index = parts[0] if parts else index
        start = self.headers[index][1]
        end = self.headers[index + 1][1] - 1 if index + 1 < len(self.headers) else len(self.lines)
        key = match["unknown"] or match["key"]
        if key:
            own = re.compile(rf"""\s*["']?{re.escape(key)}["']?\s*=""")
            for number in range(start + 1, end + 1):
                if own.match(self.lines[number - 1]):
                    return number
        return start
