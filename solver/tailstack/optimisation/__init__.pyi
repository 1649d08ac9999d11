from .course import optimise as optimise
from .half_widths import allocate as allocate
from .problem import FreeFiducial as FreeFiducial
from .problem import FreeHalfWidth as FreeHalfWidth
from .problem import PlacementProblem as PlacementProblem
from .task import influence as influence

__all__: list[str]
