"""`python -m service.cli` is `tailroad`."""

from service.cli.main import main

main()
