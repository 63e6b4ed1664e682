"""Finding the parameters behind a measured force trace: waveform, models, least squares."""
