"""`python -m fg_nav`."""

from fg_nav.cli import main

if __name__ == "__main__":
    main()
