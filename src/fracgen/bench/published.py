"""`python -m fracgen.bench.published`: an FVD that others have published, and ours of the same clips.

The comparison of universome/fvd-comparison: 128 clips of 16 frames of 224 x 224 pixels, uniform noise of
NumPy's RandomState(1), against as many of RandomState(2), given to the network in [0, 1] without another scaling. Its
README gives 10.138085 for the network of TensorFlow Hub and for its TorchScript port.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence

import numpy as np
import torch

from fracgen.features import i3d_wheel
from fracgen.metrics.fvd import frechet
from fracsim.dataset import progress
from fracsim.records import Array

PUBLISHED = 10.138085
CLIPS, SHAPE, SEEDS = 128, (16, 224, 224, 3), (1, 2)


def noise(seed: int, clips: int) -> Iterator[Array]:
    """Clips (16, 224, 224, 3) float32 of the published comparison, one at a time: the stream is that of all at once."""
    random = np.random.RandomState(seed)
    for _ in range(clips):
        yield random.rand(*SHAPE).astype(np.float32)


def features(seed: int, clips: int) -> Array:
    """Their logits, (n, 400) float64."""
    i3d = i3d_wheel.build(i3d_wheel.Settings())
    with torch.inference_mode(), torch.backends.cudnn.flags(allow_tf32=False):
        rows = [
            i3d.network(torch.from_numpy(clip).permute(3, 0, 1, 2)[None].to(i3d.device))[0].double().cpu().numpy()
            for clip in progress.shown(noise(seed, clips), clips, f"I3D, noise of seed {seed}")
        ]
    return np.stack(rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Compute and print both numbers; fewer clips than 128 only show that it runs."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.bench.published", description=__doc__)
    parser.add_argument("--clips", type=int, default=CLIPS, metavar="N", help=f"clips of each set ({CLIPS})")
    options = parser.parse_args(argv)
    if options.clips < 2:
        parser.error(f"--clips {options.clips} is not allowed: give at least 2.")
    ours = frechet(*(features(seed, options.clips) for seed in SEEDS))
    print(f"FVD of {options.clips} clips: ours {ours:.6f}, published for {CLIPS} clips {PUBLISHED}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
