"""Egos outside tailroad: black boxes over the network, and the user's own Python classes.

README.md has the protocol, its sequence and how to write an ego in another language.
"""
