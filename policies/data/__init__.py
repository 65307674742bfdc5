"""Recorded traffic as smoothed multi-vehicle scenes (I-80 and US-101 of the NGSIM programme)."""
