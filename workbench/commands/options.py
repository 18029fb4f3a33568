"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

from tyro.conf import UseAppendAction, arg

Output = Annotated[Path, arg(name="output", aliases=["-o"])]
Settings = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")]
Wishes = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=LOW..HIGH")]
ModalityName = Annotated[str | None, arg(metavar="NAME")]
Place = Annotated[str | None, arg(metavar="X,Y,Z")]
