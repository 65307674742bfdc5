"""Which processor torch trains on: `--device auto`, `cpu` or `cuda`.

Everything random is drawn on the CPU and then moved, so that the same seed gives the same numbers on any device; sums
differ in their last digits between devices, and training amplifies them. What the training hands on (networks, rows,
states of interrupted runs) lies on the CPU again.
"""

import torch

from service.errors import InputError

CHOICES = ("auto", "cpu", "cuda")


def device_of(name: str) -> torch.device:
    """The device called `name`; `auto`: a GPU where torch sees one. Raises InputError."""
    if name not in CHOICES:
        raise InputError(f"--device {name}: expected one of {', '.join(CHOICES)}")
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        reason = "no GPU is visible to it" if torch.backends.cuda.is_built() else "it was built without CUDA"
        raise InputError(
            f"--device cuda: torch {torch.__version__} cannot use a GPU here ({reason}); check the driver with "
            "nvidia-smi, or train with --device cpu"
        )
    return torch.device("cuda" if name == "cuda" or (name == "auto" and there) else "cpu")


def described(device: torch.device) -> str:
    """The device as a card names it."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else "cpu"
