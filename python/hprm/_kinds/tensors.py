"""Tensors of PyTorch.

Elements travel as an array of NumPy. A tensor on another device goes through this machine's memory,
and arrives there. PyTorch knows no read-only memory, so the receiver may write to its tensors: they
lie over the sender's memory, of which the kernel copies a page when it is first written.
"""

import sys
from typing import Any

from hprm import _hprm
from hprm._kinds import Parts, loaded

# By how many bytes elements have: what NumPy can carry them as, if it does not know their type.
_CARRIERS = {1: "uint8", 2: "int16", 4: "int32", 8: "int64"}


def tensor(array: Any, dtype: str | None, requires_grad: bool, parameter: bool) -> Any:
    """Make a tensor of PyTorch."""
    import torch

    made = torch.from_numpy(_hprm.own(array))
    if dtype is not None:
        kind = getattr(torch, dtype)
        if not isinstance(kind, torch.dtype):
            raise ValueError(f"malformed payload: PyTorch has no type {dtype}")
        made = made.view(kind)
    if parameter:
        return torch.nn.Parameter(made, requires_grad)
    return made.requires_grad_(requires_grad)


def taker(kind: type) -> Any:
    """Return what takes apart tensors of PyTorch."""
    torch = loaded("torch")
    if torch is not None and kind in (torch.Tensor, torch.nn.Parameter):
        return _take_tensor
    return None


def _take_tensor(value: Any) -> Parts | None:
    torch: Any = sys.modules["torch"]
    if value.layout is not torch.strided or value.is_quantized or value.__dict__:
        return None
    elements = value.detach().cpu().resolve_conj().resolve_neg()
    parameter = type(value) is torch.nn.Parameter
    try:
        array, dtype = elements.numpy(), None
    except TypeError:
        carrier = _CARRIERS.get(elements.element_size())
        if carrier is None:
            return None
        dtype = str(elements.dtype).removeprefix("torch.")
        array = elements.view(getattr(torch, carrier)).numpy()
    return tensor, (array, dtype, value.requires_grad, parameter)
