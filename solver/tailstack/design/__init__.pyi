from .compile import check_design as check_design
from .compile import compile_design as compile_design
from .document import design_json_schema as design_json_schema
from .loading import Design as Design
from .loading import load_design as load_design
from .presets import list_presets as list_presets
from .reading import DEFAULT_LIMITS as DEFAULT_LIMITS
from .reading import Limits as Limits
from .write import Revision as Revision
from .write import design_to_data as design_to_data
from .write import design_to_json as design_to_json
from .write import design_to_yaml as design_to_yaml
from .write import revise_design as revise_design

__all__: list[str]
