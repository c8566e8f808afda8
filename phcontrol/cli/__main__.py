"""``python -m phcontrol.cli``."""

from phcontrol.cli.application import main

if __name__ == "__main__":
    main()
