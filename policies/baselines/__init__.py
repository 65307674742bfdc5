"""Drivers to compare with: an intelligent driver that changes lanes by MOBIL, fitted to the same recordings."""
