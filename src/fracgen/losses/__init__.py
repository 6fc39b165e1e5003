"""What is minimised: flow matching (Eq. 1 of the paper) and the latent constitutive regulariser (Eq. 8 to 10)."""
