"""The weights that lie in docs generate a clip, as docs/laptop.md says."""

from pathlib import Path

import fracsim.sample
from fracgen.sample import SAMPLE
from fracgen.sampling import job

DOCS = Path(__file__).parents[2] / "docs"


def test_the_weights_in_docs_generate_a_clip(tmp_path: Path) -> None:
    photo, weights = DOCS / "photos/croissant.jpg", DOCS / "laptop_weights"
    pull = [f"image={photo}", f"condition={photo.with_suffix('.json')}"]
    vae = ["vae=tiny", f"vae.path={weights / 'vae'}", "encoders=tiny"]
    config = SAMPLE.compose(f"run={weights / 'generator'}", *pull, *vae, "sampler=preview", f"output.folder={tmp_path}")
    (folder,) = job.run(config)
    clip = fracsim.sample.read(folder)
    assert clip.rgb.shape == (21, 96, 96, 3)
    assert set(clip.meta["maps"]) == {"flow", "strain", "stress", "damage"}
    assert clip.read("damage").std() > 0
