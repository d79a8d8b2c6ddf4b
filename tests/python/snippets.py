"""Pieces of program text for preambles: functions that the programs of several tests share."""

from __future__ import annotations

TELL = """
import os, pathlib

def tell(file, text):
    "Put a text where the test finds it, all of it or nothing."
    draft = pathlib.Path(f"{file}.{os.getpid()}.draft")
    draft.write_text(text)
    draft.rename(file)

def here(name):
    "Say which process this is, and that it has come here."
    tell(f"{name}.pid", f"{os.getpid()}\\n")
"""

PLACE = """
def place(array):
    "Where an array lies: the number of the file, the position in it, how it is mapped, its name."
    address = array.__array_interface__["data"][0]
    with open("/proc/self/maps") as maps:
        for line in maps:
            span, mode, offset, _, inode, *name = line.split()
            start, end = (int(number, 16) for number in span.split("-"))
            if start <= address < end:
                return int(inode), int(offset, 16) + address - start, mode, " ".join(name)
"""
