from .course import optimise as optimise
from .placement import PlacementSolution as PlacementSolution
from .placement import solve_placement as solve_placement
from .problem import FreeFiducial as FreeFiducial
from .problem import FreeHalfWidth as FreeHalfWidth
from .problem import PlacementProblem as PlacementProblem
from .task import influence as influence

__all__: list[str]
