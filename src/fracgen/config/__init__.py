"""The vocabulary of fracgen's programs: plain dataclasses of knobs, one file a section; the schema of conf/."""
