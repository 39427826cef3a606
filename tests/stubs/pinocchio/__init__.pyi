# pinocchio is a compiled module without type information: to pyright, everything in it is Any.
from typing import Any

def __getattr__(name: str) -> Any: ...
