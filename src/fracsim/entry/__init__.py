"""How a program of `fracsim.scene.program` runs from the command line: its errors, its help, its signals; no Taichi."""

from fracsim.entry.command import BAD, INTERRUPTED, complain, launch, main
from fracsim.entry.interrupt import Interrupt, interrupted
from fracsim.entry.signs import SIGNS, signs_every

__all__ = ["BAD", "INTERRUPTED", "SIGNS", "Interrupt", "complain", "interrupted", "launch", "main", "signs_every"]
