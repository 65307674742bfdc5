"""The dashboard: pages on jobs, estimates and failures, which read through the query API alone.

link.py      asks the service in threads, remembers answers for a moment, knows whether anybody answers
live.py      what jobs tell, passed on to browsers as server-sent events
guard.py     who may ask: host names, origins, the headers of every answer
app.py       which address shows what
server.py    one address that browsers reach
pages/       what each page needs, as plain values; templates/ how it looks; charts/ pictures as SVG
"""
