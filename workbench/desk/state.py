"""What `endoct open` keeps for its user, outside of every study: the queue, recent folders, and the secret address."""

import json
import os
import re
import secrets
import time
from contextlib import closing, suppress
from dataclasses import dataclass
from html import escape
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from tempfile import mkstemp

from platformdirs import user_state_path

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import is_folder
from endoct.base.files.json_values import read_object
from endoct.workbench.desk.runs import Queue

MOST_RECENT = 20
OPEN_HTML = "open.html"
ANSWER_S = 30
"""How long a server that may still run is waited for."""


@dataclass(frozen=True)
class Recent:
    """A folder that was opened, and when."""

    folder: Path
    opened: str


class State:
    """The user's own folder for this; nobody else may look into it."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = user_state_path("endoct", appauthor=False) if folder is None else folder
        with refusing(f"{self.folder} cannot be used", remedy="set XDG_STATE_HOME to a folder where you may write"):
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.folder.chmod(0o700)
        self.queue = Queue(self.folder / "queue")

    @property
    def token(self) -> str:
        """The part of the address that nobody can guess; the same every time, so that a bookmark holds."""
        path = self.folder / "token"
        with suppress(OSError, UnicodeDecodeError):
            text = path.read_text("ascii").strip()
            if len(text) >= 32 and text.isalnum():
                return text
        text = secrets.token_hex(16)
        self._write("token", text)
        return text

    def address_file(self, address: str) -> Path:
        """Write a page that leads to ``address``, for a browser to open, and return its path.

        A browser's own command line can be read by other users of the machine; this file cannot.
        """
        page = f'<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={escape(address)}">'
        return self._write(OPEN_HTML, page)

    def running(self) -> str | None:
        """Return the start page of a server that the file of :meth:`address_file` leads to, None where none answers."""
        with suppress(OSError, HTTPException):
            found = re.search(rf"http://([^/\"]+)(/{self.token}/)", (self.folder / OPEN_HTML).read_text("utf-8"))
            if found:
                connection = HTTPConnection(found[1], timeout=ANSWER_S)
                with closing(connection):
                    connection.request("GET", found[2])
                    return found[0] if connection.getresponse().status == 200 else None
        return None

    def recent(self) -> list[Recent]:
        """Return the folders that were opened and are still there, the last one first."""
        return [each for each in self._listed() if is_folder(each.folder)]

    def _listed(self) -> list[Recent]:
        """Return the folders that were opened, those that cannot be seen now as well."""
        listed: list[Recent] = []
        with suppress(EndoctError):
            for each in read_object(self.folder / "recent.json").get("folders", []):
                folder = Path(str(each.get("folder"))) if isinstance(each, dict) else None
                if folder is not None and folder.is_absolute():
                    listed.append(Recent(folder, str(each.get("opened", ""))[:30]))
        return listed[:MOST_RECENT]

    def remember(self, folder: Path) -> None:
        """Put ``folder`` first among the recent ones."""
        others = [each for each in self._listed() if each.folder != folder]
        listed = [Recent(folder, time.strftime("%Y-%m-%d %H:%M")), *others][:MOST_RECENT]
        text = json.dumps({"folders": [{"folder": str(each.folder), "opened": each.opened} for each in listed]})
        self._write("recent.json", text)

    def _write(self, name: str, text: str) -> Path:
        """Write a file that only its user can read, at one stroke."""
        path = self.folder / name
        with refusing(f"{path} cannot be written"):
            handle, scratch = mkstemp(prefix=f".{name}-", dir=self.folder)
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            Path(scratch).replace(path)
        return path
