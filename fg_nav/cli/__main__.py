"""`python -m fg_nav.cli`."""

from fg_nav.cli import main

if __name__ == "__main__":
    main()
