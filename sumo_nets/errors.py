"""The one error of this package.

ValueError
  NetworkError    a network, an edge list or a source file cannot be used; the message says what to do
"""


class NetworkError(ValueError):
    """A network or its sources cannot be used as asked."""
