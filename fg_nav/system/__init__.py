"""What the operating system is asked for: compiled code, processes, signals, locks, memory, and a place for scratch."""
