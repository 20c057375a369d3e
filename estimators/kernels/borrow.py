"""Hand an array to helpers without counting references.

numba counts a reference up and down, atomically, around every helper that takes an array, and inlining does not
remove all of them: some 5 ns each, more than a small helper's work. A kernel's arguments outlive it, so it can borrow
them: the same array type without an owner to count for.
"""

from typing import Any

from numba.core import cgutils
from numba.extending import intrinsic


def _borrow(typingctx: Any, array: Any) -> Any:
    """The same array without its owner; valid as long as the original is."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        mine = context.make_array(signature.args[0])(context, builder, args[0])
        mine.meminfo = cgutils.get_null_value(mine.meminfo.type)
        mine.parent = cgutils.get_null_value(mine.parent.type)
        return mine._getvalue()

    return array(array), generate


borrow: Any = intrinsic(_borrow)
