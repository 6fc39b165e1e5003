"""python -m fracgen.encode: turn a data set into a latent cache, print what came of it."""

import sys
from pathlib import Path
from typing import Any

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracgen.config.encode import EncodeConfig
from fracsim.scene.program import Program

ENCODE: Program[EncodeConfig] = Program("fracgen.encode", "encode", EncodeConfig)
RESUME = "repeat the command to go on; clips that are in the cache are not encoded again"


def task(cfg: Any) -> None:
    """Encode, or verify, as a composed configuration says; raises ValueError, OSError."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    overrides: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
    config = ENCODE.resolve(cfg, overrides)
    (verify if config.verify else encode)(config)


def encode(cfg: EncodeConfig) -> None:
    """Encode a data set and print what came of it; raises ValueError, OSError."""
    import torch

    from fracgen import vae
    from fracgen.data import encoding
    from fracgen.data.choose import told

    there = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    name = cfg.device if cfg.device != "auto" else "cuda" if there["cuda"] else "cpu"
    if not there[name]:
        raise ValueError(f"device={name} is not on this machine: set device=cpu.")
    device = torch.device(name)
    found = encoding.encode(cfg, vae.load(cfg.vae, device), device)
    for line in filter(None, (*told(found.left_out), found.odd())):
        print(line, file=sys.stderr)
    for name, (mean, std) in found.statistics().items():
        print(f"{name:<7} mean {mean:+.3f}  std {std:.3f}")
    print(f"{found.done} clips encoded at {found.rate()}; {found.asked - found.todo} were there already")
    print(Path(cfg.output.folder).expanduser())


def verify(cfg: EncodeConfig) -> None:
    """Compare all files of a cache with their hashes; raises ValueError naming those that are not as written."""
    from fracgen.data import index

    folder = Path(cfg.output.folder).expanduser()
    found = index.load(folder)
    wrong = index.lacking(found, folder, hashes=True)
    if wrong:
        named = "; ".join(f"{name} {why}" for name, why in wrong.items())
        raise ValueError(f"output.folder={folder}: {named}. Remove such files and repeat the command without "
                         "verify=true: their clips are encoded again.")  # fmt: skip
    waiting = sum(not row["sha256"] for row in found.rows)
    size = sum(entry["bytes"] for entry in found.files.values())
    print(f"{len(found.rows) - waiting} clips in {len(found.files)} files, {size / 2**20:.3g} MB: all as written"
          f"{f'; {waiting} clips wait to be encoded again' if waiting else ''}")  # fmt: skip


run = hydra.main(config_path=str(ENCODE.folder), config_name=ENCODE.primary, version_base="1.3")(task)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.main(ENCODE, run, RESUME)


if __name__ == "__main__":
    main()
