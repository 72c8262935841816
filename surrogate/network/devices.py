"""Where torch computes: the processor, or a GPU where there is one."""

from __future__ import annotations

from ..errors import SurrogateError


def chosen_device(asked: str | None) -> str:
    """Name of the device that is asked for, or of a GPU where there is one and nothing is asked for.

    Args:
        asked: "cpu", "cuda", "cuda:1" and so on; None: what there is.

    Raises:
        SurrogateError: there is no such device here.
    """
    import torch

    if asked is None:
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(asked)
    except RuntimeError:
        raise SurrogateError(f"--device {asked}: is no device of torch; take cpu or cuda") from None
    if device.type == "cpu":
        return asked
    count = torch.cuda.device_count() if device.type == "cuda" and torch.cuda.is_available() else 0
    if (device.index or 0) >= count:
        there = f"there are {count} GPUs" if count else "there is no GPU that torch can use"
        raise SurrogateError(f"--device {asked}: {there}; take cpu, or leave it out")
    return asked
