"""Part of the site's build: its footer says which version of endoct the pages are of."""

import tomllib
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig

PROJECT = Path(__file__).parents[1] / "pyproject.toml"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the version before the copyright."""
    version = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["version"]
    config.copyright = f"endoct {version}. {config.copyright}"
    return config
