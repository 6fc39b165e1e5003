"""What the commands that examine fracsim itself share: verify, bench, fuzz, and the proof that a refactor is one."""
