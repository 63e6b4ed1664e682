"""How the parameters behind a measured force trace are found: waveform, models, least squares."""

__all__ = ["models", "solve", "starts", "waveform"]
