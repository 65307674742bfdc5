"""The one error of this package.

ValueError
  NetworkError    a network, an edge list or a source file cannot be used; the message says what to do
    EdgesError    the network can be read, but not along these edges
"""


class NetworkError(ValueError):
    """A network or its sources cannot be used as asked."""


class EdgesError(NetworkError):
    """The list of edges is not a road through the network."""
