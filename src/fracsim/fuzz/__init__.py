"""Does it hold? `python -m fracsim.fuzz` draws scenes far beyond the published ranges and checks what comes of them.

A scene must end either finished, finite and with its invariants kept (`invariants`), or with the clear error that fits
(`fitting`). Anything else, a crash and a hang included, is `wrong`, and its scene is kept as a file to be replayed.
"""
