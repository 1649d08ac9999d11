from .batch import score_batch as score_batch
from .design import Design as Design
from .design import compile_design as compile_design
from .design import load_design as load_design
from .design_function import DesignFunction as DesignFunction
from .errors import DesignError as DesignError
from .errors import IllPosedError as IllPosedError
from .errors import InfeasibleError as InfeasibleError
from .errors import LimitError as LimitError
from .errors import MissingExtraError as MissingExtraError
from .errors import NotConvergedError as NotConvergedError
from .errors import OutOfRangeError as OutOfRangeError
from .errors import Problem as Problem
from .errors import TailstackError as TailstackError
from .optimisation import allocate as allocate
from .optimisation import optimise as optimise
from .scoring import score as score
from .sweeping import sweep as sweep
from .verification import verify as verify
from .version import __version__ as __version__

__all__: list[str]
