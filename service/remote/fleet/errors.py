"""What can go wrong in asking a fleet, beyond service.errors."""

from service.errors import InputError


class NoSuchJob(InputError):
    """A job that there is not."""

    def __init__(self, job: str):
        super().__init__(f"there is no job {job[:100]!r}; `tailroad jobs` lists them")
