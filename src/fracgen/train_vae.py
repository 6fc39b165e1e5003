"""python -m fracgen.train_vae: train a small video autoencoder on simulated clips."""

import json
import os
import time
from pathlib import Path
from typing import Any

from fracgen.config.train_vae import TrainVaeConfig
from fracsim import entry
from fracsim.scene.program import Program

PROGRAM: Program[TrainVaeConfig] = Program("fracgen.train_vae", "train_vae", TrainVaeConfig)
RESUME = "repeat the command to go on from the last checkpoint"
RESULT = "train_vae.json"
"""Written last: a folder that has it is finished."""


def run(cfg: TrainVaeConfig) -> Path:
    """Train, and write weights, errors and the sheet; gives the folder.

    Raises ValueError for clips that do not do, and for a folder that holds something else.
    """
    import torch

    from fracgen.layout import latent_frames, latent_size
    from fracgen.vae import FrozenVae, build, clips, fit, judge

    latent_frames(cfg.frames)
    latent_size(cfg.size, cfg.size)
    folder = _folder(cfg)
    if folder is None:
        return Path(cfg.output.folder).expanduser()
    device = fit.device(cfg.device)
    videos = clips.load(cfg.data, cfg.clips)
    held_out = clips.spread(len(videos), min(cfg.held_out, len(videos) - 1))
    seen = [video for k, video in enumerate(videos) if k not in held_out]
    start, used = time.perf_counter(), time.process_time()
    network = fit.train(cfg, build(cfg.vae).to(device), seen)
    seconds, used = time.perf_counter() - start, time.process_time() - used
    mean, std = judge.statistics(network, seen)
    network.register_to_config(latents_mean=mean, latents_std=std)
    _publish(network, folder)
    vae = FrozenVae(network)
    unseen = [videos[k] for k in held_out]
    found = {"streams": judge.errors(vae, unseen), "identity": vae.identity, "latents_mean": mean, "latents_std": std,
             "held_out": [video.id for video in unseen], "steps": cfg.steps, "seconds_since_start": round(seconds, 1),
             "processor_seconds": round(used, 1),
             "threads": torch.get_num_threads(), "device": str(device)}  # fmt: skip
    judge.sheet(vae, unseen[0], folder / "sheet.png")
    _write(folder / RESULT, json.dumps(found, indent=2) + "\n")
    (folder / fit.CHECKPOINT).unlink(missing_ok=True)
    _report(found, folder)
    return folder


def _folder(cfg: TrainVaeConfig) -> Path | None:
    """The output folder, made; None when it is finished; raises ValueError when it holds another VAE."""
    folder = Path(cfg.output.folder).expanduser()
    if (folder / RESULT).is_file() and not cfg.output.overwrite:
        print(f"{folder} is finished; set output.overwrite=true to train again")
        return None
    if (folder / "config.json").is_file() and not cfg.output.overwrite and not (folder / "last.pt").is_file():
        raise ValueError(f"output.folder={cfg.output.folder} holds a VAE that this program has not made: choose "
                         "another folder, or set output.overwrite=true.")  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / RESULT).unlink(missing_ok=True)
    return folder


def _publish(network: Any, folder: Path) -> None:
    """Move weights and then their config into the folder: without a config it is no VAE."""
    part = folder / "partial"
    network.save_pretrained(part)
    (folder / "config.json").unlink(missing_ok=True)
    for file in sorted(part.iterdir(), reverse=True):
        os.replace(file, folder / file.name)
    part.rmdir()


def _write(path: Path, text: str) -> None:
    part = path.with_suffix(".partial")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def _report(found: dict[str, Any], folder: Path) -> None:
    for name, error in found["streams"].items():
        print(f"{name:8} PSNR {error['psnr']:5.1f} dB, of one colour {error['psnr_of_one_colour']:5.1f} dB")
    print(f"{found['steps']} steps, {found['seconds_since_start']:g} s ({found['processor_seconds']:g} s of processor "
          f"time); look at {folder / 'sheet.png'}, "
          f"use vae.path={folder}")  # fmt: skip


def main() -> None:
    """Entry point; exit status 0 when the VAE is trained, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(PROGRAM, run, RESUME)


if __name__ == "__main__":
    main()
