"""Many samples as one data set: its plan, its table, reading it, checking it, and copies in formats of others.

Two lines read it, without Taichi:

    clips = fracsim.dataset.open("outputs").filter(split="train", object="duck")
    stress = clips[0].read("stress", 0, 17)

`clips.table` is the table as a pyarrow Table. docs/data.md says what lies in the folder.
"""

from fracsim.dataset.reader import Clip, Clips, open

__all__ = ["Clip", "Clips", "open"]
