"""A folder of evidence that stands alone, signed, and its verification.

objects.py   claims with what supports them, and the manifest
signature.py Ed25519 signatures in the form of minisign
goals.py     the claims as a goal structure, in Markdown and as a picture
material.py  what is said of one run: estimates, failures, severity, prevention, films
gather.py    from runs to the folder
check.py     whether a folder says what it said when it was signed
"""
