"""Stands for Plasma. Its classes are of another module: what is of pyarrow is an Arrow value."""

from plasma_store import ObjectID, connect

__all__ = ["ObjectID", "connect"]
