"""Scores of clips: what metrics see, how they are observed, reduced, stored, summed up and shown."""
