"""Counts in sentences."""


def counted(count: int, thing: str) -> str:
    """Put a count before a thing, and an s behind it if there is not one of it."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
