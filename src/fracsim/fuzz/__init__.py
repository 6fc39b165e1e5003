"""The stress test: `python -m fracsim.fuzz` draws scenes far beyond the published ranges, runs and checks them.

A scene must either finish, with finite numbers and all invariants kept (`invariants`), or be refused by an error that
fits it (`fitting`). Any other end, a crash or a hang included, is `wrong`. Wrong scenes are kept as files for a replay.
"""
