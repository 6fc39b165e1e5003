"""How metrics react to what is wrong with a clip: `python -m fracgen.sensitivity`."""
