"""`python -m sbfem_petsc` is the command `sbfem`."""

from .cli import main

if __name__ == "__main__":
    main()
