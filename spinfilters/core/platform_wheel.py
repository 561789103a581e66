"""Wheels of one platform where they hold compiled libraries, of any where they hold none; setuptools calls it."""

from pathlib import Path

from setuptools.command.bdist_wheel import bdist_wheel


class PlatformWheel(bdist_wheel):
    """Build of a wheel for every Python 3: its libraries are loaded by ctypes and know no Python."""

    def finalize_options(self) -> None:
        """Name the platform where ``.ci/libraries.py`` has built libraries."""
        if any(Path(__file__).with_name("libraries").glob("*.so")):
            self.distribution.has_ext_modules = lambda: True  # by which setuptools knows such a wheel
        super().finalize_options()

    def get_tag(self) -> tuple[str, str, str]:
        """Tags of Python, its binary interface, and the platform."""
        python, interface, machine = super().get_tag()
        return (python, interface, machine) if self.root_is_pure else ("py3", "none", machine)
