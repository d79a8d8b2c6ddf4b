"""Modules that are compiled whenever they are loaded, as Python compiles a script.

What Python keeps of a module counts for a second after its file has changed, if its length is the
same; and it lies in the folder of the file.
"""

from __future__ import annotations

from importlib.machinery import SourceFileLoader
from types import CodeType


class UncachedLoader(SourceFileLoader):
    """Compiles a file whenever it is loaded."""

    def get_code(self, fullname: str) -> CodeType:
        """Compile the file."""
        path = self.get_filename(fullname)
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code
