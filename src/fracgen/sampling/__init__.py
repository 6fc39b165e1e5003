"""From a picture and a condition to a clip: solvers of the flow's equation, guidance, decoding, samples on disk."""
