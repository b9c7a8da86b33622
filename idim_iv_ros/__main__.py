"""`python -m idim_iv_ros`: the command `idim-iv`, where its script is not on PATH."""

from idim_iv_ros.cli.main import main

if __name__ == "__main__":
    main()
