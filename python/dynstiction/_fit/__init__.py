"""Finding the parameters behind a measured force trace: waveform, models, least squares."""

__all__ = ["models", "problem", "search", "solve", "waveform"]
