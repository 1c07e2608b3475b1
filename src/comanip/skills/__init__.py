"""Skills: observation to command. `paper` is the reference, `collaborate` the default, `baselines` what to beat."""
