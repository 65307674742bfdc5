"""`python -m service.front.cli` is `tailroad`."""

from service.front.cli.main import main

main()
