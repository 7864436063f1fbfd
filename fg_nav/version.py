"""Which version of the package is installed."""

from importlib import metadata


def version() -> str:
    """Version of the installed distribution, or words that say there is none."""
    try:
        return metadata.version("fg-nav")
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"
