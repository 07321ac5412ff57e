"""Objects that draw themselves, and packages that are called as functions: what the API adds to both."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110


class Shown:
    """`plot()` gives a picture of the object; a notebook shows it below the object's line of text.

    picture: where the picture is made, `module:function` of the object. It is named, not imported: pictures are made
    from the objects that have them.
    """

    picture: ClassVar[str]

    def plot(self) -> Figure:
        module, _, name = self.picture.partition(":")
        figure: Figure = getattr(import_module(module), name)(self)
        return figure

    def _repr_html_(self) -> str:
        png = io.BytesIO()
        self.plot().savefig(png, format="png", dpi=_DPI)
        data = base64.b64encode(png.getvalue()).decode()
        return f'<p>{html.escape(str(self))}</p><img src="data:image/png;base64,{data}" alt="">'


class CalledPackage(ModuleType):
    """A package of `mrdamp` that is also the function of its name in `mrdamp.api`: `mrdamp.identify(records)`."""

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        """The function; tools that show a signature follow this name."""
        function: Callable[..., Any] = getattr(import_module("mrdamp.api"), self.__name__.rpartition(".")[2])
        return function

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self.__wrapped__(*args, **options)
