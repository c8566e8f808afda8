"""``python -m phcontrol.cli``."""

from phcontrol.cli import main

if __name__ == "__main__":
    main()
