"""Lists every package below the top-level folders, so that none is missing from a wheel; and the entry of menus."""

from setuptools import find_packages, setup

FOLDERS = ("base", "modalities", "stitching", "fusion", "synthetic", "workbench")

setup(
    packages=[f"endoct.{folder}" for folder in FOLDERS]
    + [f"endoct.{folder}.{package}" for folder in FOLDERS for package in find_packages(folder)],
    data_files=[("share/applications", ["workbench/desk/endoct.desktop"])],
)
