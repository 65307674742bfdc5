"""The fleet's API for any Zenoh client: JSON on keys below tailroad/v1/.

Api (server.py)              queries and events over a Zenoh session
Application (application.py) a key, parameters and a body in; a body or a problem out; no network
routes.py                    which key takes what, does what and answers what
objects.py, requests.py      what goes over the wire; the published schemas are made of them
README.md                    the same for readers in any language
"""
