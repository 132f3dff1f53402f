"""Folders of each package; ``pyproject.toml`` has the rest.

The folders of the top level are packages of ``steer_by_wire``, and so is with-vcan, which is also a
distribution of its own. Inside the checkout symbolic links say so; an installation goes by this,
and is whole where git has made no links.
"""

from setuptools import find_packages, setup

FOLDERS = ("closed_loop", "controller", "dbc", "hand_wheel", "plant_emulator", "runtime", "tools")
PACKAGES = find_packages(include=[name for folder in FOLDERS for name in (folder, f"{folder}.*")])
WITH_VCAN = "steer_by_wire.with_vcan"

setup(
    packages=["steer_by_wire", WITH_VCAN, *(f"steer_by_wire.{package}" for package in PACKAGES)],
    package_dir={f"steer_by_wire.{folder}": folder for folder in FOLDERS}
    | {WITH_VCAN: "packaging/with_vcan/with_vcan"},
)
