"""The laptop study: data, trainings, samples and scores at a scale that a laptop runs in three hours."""
