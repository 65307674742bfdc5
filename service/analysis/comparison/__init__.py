"""Egos, or runs, on the same question: how p differs, and which ways to fail came and went."""
