"""The tests of the laptop study need the extra `gen`, which Python 3.10 does not have."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("torch") else ["*"]
