"""Classes and splits of the ten objects: the split is by object, never by draw."""

OBJECTS = {
    "low_stretch": ("croissant", "cake", "muffin", "bread", "bread_roll"),
    "high_stretch": ("duck", "bear", "ring", "star", "whale"),
}
"""Material classes of the paper, five objects each."""
LAWS = {
    "fixed_corotated": "low_stretch",
    "neo_hookean": "high_stretch",
    "neo_hookean_decoupled": "high_stretch",
}
"""The class that a constitutive law stands for, for objects that are not among the ten."""
TRAIN = tuple(name for names in OBJECTS.values() for name in names[:3])
TEST = tuple(name for names in OBJECTS.values() for name in names[3:])
NONE = "none"
"""The split and the class of what has none."""
SPLITS = ("train", "test", NONE)
TRAINING_FRAMES = 81
"""Frames 0 to 80 of a clip are those of training."""


def split_of(name: str) -> str:
    """The split of an object, "train", "test" or "none"."""
    return "train" if name in TRAIN else "test" if name in TEST else NONE


def class_of(name: str) -> str:
    """The material class of an object or of a constitutive law, or "none"."""
    return next((kind for kind, names in OBJECTS.items() if name in names), LAWS.get(name, NONE))
