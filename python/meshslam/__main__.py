"""`python -m meshslam` is `meshslam`."""

from meshslam.cli import main

if __name__ == "__main__":
    main()
