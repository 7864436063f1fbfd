"""A stream of canonical rows into a navigator, and one JSON line for each footfall out.

The data's way: `sources` (bytes as they come), `rows` (bytes to samples), `fg_nav.online` (samples to estimates),
`lines` (estimates to JSON), `server` (lines to whoever listens); `follow` calls them in this order until the stream
ends, and `ended` makes a result of the walk.
"""

from fg_nav.stream.follow import StreamOptions, follow

__all__ = ["StreamOptions", "follow"]
