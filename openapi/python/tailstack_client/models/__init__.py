"""Contains all the data models used in inputs/outputs"""

from .additivity import Additivity
from .aimed_view import AimedView
from .allowance import Allowance
from .allowance_status import AllowanceStatus
from .axis import Axis
from .batch import Batch
from .batch_columns import BatchColumns
from .batch_pointers import BatchPointers
from .batch_request import BatchRequest
from .batch_request_columns_item import BatchRequestColumnsItem
from .batch_request_table import BatchRequestTable
from .batch_ways import BatchWays
from .beam_angle import BeamAngle
from .beam_direction import BeamDirection
from .bias_compared import BiasCompared
from .bias_compared_interval_of import BiasComparedIntervalOf
from .bounds import Bounds
from .calibration import Calibration
from .certificate import Certificate
from .change import Change
from .change_kind import ChangeKind
from .changed_spacing import ChangedSpacing
from .changed_tolerance import ChangedTolerance
from .check import Check
from .check_status import CheckStatus
from .comparison import Comparison
from .comparison_headline import ComparisonHeadline
from .comparison_headline_status import ComparisonHeadlineStatus
from .comparison_request import ComparisonRequest
from .comparison_request_parts_item import ComparisonRequestPartsItem
from .comparison_test import ComparisonTest
from .comparison_test_sides import ComparisonTestSides
from .comparison_test_test import ComparisonTestTest
from .contributor import Contributor
from .convergence import Convergence
from .convergence_point import ConvergencePoint
from .conversion import Conversion
from .conversion_format import ConversionFormat
from .conversion_request import ConversionRequest
from .conversion_request_base_type_0 import ConversionRequestBaseType0
from .conversion_request_format import ConversionRequestFormat
from .conversion_request_to import ConversionRequestTo
from .conversion_request_xmalab_type_0 import ConversionRequestXmalabType0
from .converted_body import ConvertedBody
from .converted_point import ConvertedPoint
from .count_tried import CountTried
from .coupling_case import CouplingCase
from .coupling_case_coupling import CouplingCaseCoupling
from .coupling_case_reading import CouplingCaseReading
from .design import Design
from .design_patch import DesignPatch
from .difference import Difference
from .difference_basis import DifferenceBasis
from .difference_conclusion import DifferenceConclusion
from .drawn_losses import DrawnLosses
from .error_distribution import ErrorDistribution
from .estimator_case import EstimatorCase
from .example_entry import ExampleEntry
from .example_list import ExampleList
from .exceedance import Exceedance
from .explanation import Explanation
from .explanation_kind import ExplanationKind
from .factor import Factor
from .finding import Finding
from .finding_severity import FindingSeverity
from .front_point import FrontPoint
from .front_point_status import FrontPointStatus
from .gate import Gate
from .gate_fail_level import GateFailLevel
from .gate_finding import GateFinding
from .gate_finding_severity import GateFindingSeverity
from .gate_mode import GateMode
from .gate_number import GateNumber
from .gate_number_status import GateNumberStatus
from .gate_on_inconclusive_type_0 import GateOnInconclusiveType0
from .gate_provenance import GateProvenance
from .gate_request import GateRequest
from .gate_request_baseline_type_0 import GateRequestBaselineType0
from .gate_request_design import GateRequestDesign
from .gate_request_design_design_type_0 import GateRequestDesignDesignType0
from .gate_request_fail_level import GateRequestFailLevel
from .gate_request_mode import GateRequestMode
from .gate_request_on_inconclusive_type_0 import GateRequestOnInconclusiveType0
from .gate_request_policy_type_0 import GateRequestPolicyType0
from .gate_request_waivers_type_0 import GateRequestWaiversType0
from .gate_requirement import GateRequirement
from .gate_requirement_error import GateRequirementError
from .gate_requirement_origin import GateRequirementOrigin
from .gate_requirement_severity import GateRequirementSeverity
from .gate_section import GateSection
from .gate_target import GateTarget
from .gate_verdict import GateVerdict
from .gated_design import GatedDesign
from .gated_design_basis import GatedDesignBasis
from .gated_design_verdict import GatedDesignVerdict
from .geometry import Geometry
from .get_openapi_response_200 import GetOpenapiResponse200
from .get_report_format import GetReportFormat
from .get_schema_draft import GetSchemaDraft
from .get_schema_response_200 import GetSchemaResponse200
from .headline import Headline
from .headline_status import HeadlineStatus
from .health import Health
from .imaged_point import ImagedPoint
from .imaged_view import ImagedView
from .index import Index
from .installation_level import InstallationLevel
from .job import Job
from .job_kind import JobKind
from .job_links import JobLinks
from .job_page import JobPage
from .job_progress import JobProgress
from .job_state import JobState
from .layout import Layout
from .layout_request import LayoutRequest
from .layout_scene_type_0 import LayoutSceneType0
from .level_compared import LevelCompared
from .level_ratio import LevelRatio
from .level_shape import LevelShape
from .linearity_point import LinearityPoint
from .linearity_point_errs_type_0 import LinearityPointErrsType0
from .linearity_point_status import LinearityPointStatus
from .linearity_point_within_type_0 import LinearityPointWithinType0
from .link import Link
from .list_jobs_kind import ListJobsKind
from .list_jobs_state import ListJobsState
from .local_optimum import LocalOptimum
from .loss import Loss
from .losses import Losses
from .measured_file import MeasuredFile
from .measured_file_form import MeasuredFileForm
from .metric_estimate import MetricEstimate
from .metric_score import MetricScore
from .mixture import Mixture
from .moved_fiducial import MovedFiducial
from .moved_pivot import MovedPivot
from .norm_compared import NormCompared
from .optimisation import Optimisation
from .optimisation_design import OptimisationDesign
from .optimisation_design_before import OptimisationDesignBefore
from .optimisation_request import OptimisationRequest
from .optimisation_verdict_status import OptimisationVerdictStatus
from .paper_cell import PaperCell
from .paper_cell_quantity import PaperCellQuantity
from .paper_cell_table import PaperCellTable
from .per_unit import PerUnit
from .placed_point import PlacedPoint
from .placement_value import PlacementValue
from .preset_entry import PresetEntry
from .preset_list import PresetList
from .printed_cell import PrintedCell
from .printed_cell_table import PrintedCellTable
from .printed_cell_unit import PrintedCellUnit
from .problem import Problem
from .problem_entry import ProblemEntry
from .problem_type import ProblemType
from .propagation import Propagation
from .provenance import Provenance
from .quantile_point import QuantilePoint
from .ratio import Ratio
from .readiness import Readiness
from .readiness_database import ReadinessDatabase
from .readiness_kernels import ReadinessKernels
from .readiness_status_type_0 import ReadinessStatusType0
from .readiness_status_type_1 import ReadinessStatusType1
from .relaxation import Relaxation
from .report import Report
from .report_design import ReportDesign
from .report_request import ReportRequest
from .report_request_parts_item import ReportRequestPartsItem
from .reproduction import Reproduction
from .reprojection import Reprojection
from .schema_entry import SchemaEntry
from .schema_list import SchemaList
from .score import Score
from .score_request import ScoreRequest
from .second_order import SecondOrder
from .second_order_status import SecondOrderStatus
from .shadow_price import ShadowPrice
from .slip_reliability import SlipReliability
from .spread_compared import SpreadCompared
from .spread_compared_of import SpreadComparedOf
from .statement import Statement
from .statement_about import StatementAbout
from .study_comparison import StudyComparison
from .study_comparison_error import StudyComparisonError
from .study_comparison_request import StudyComparisonRequest
from .study_comparison_request_error import StudyComparisonRequestError
from .study_comparison_verdict import StudyComparisonVerdict
from .study_coupling import StudyCoupling
from .study_coupling_error import StudyCouplingError
from .study_coupling_request import StudyCouplingRequest
from .study_coupling_request_error import StudyCouplingRequestError
from .study_estimators import StudyEstimators
from .study_estimators_request import StudyEstimatorsRequest
from .study_linearity import StudyLinearity
from .study_linearity_error import StudyLinearityError
from .study_linearity_request import StudyLinearityRequest
from .study_linearity_request_error import StudyLinearityRequestError
from .study_paper import StudyPaper
from .study_paper_request import StudyPaperRequest
from .study_views import StudyViews
from .study_views_error import StudyViewsError
from .study_views_request import StudyViewsRequest
from .study_views_request_error import StudyViewsRequestError
from .survived_loss import SurvivedLoss
from .sweep import Sweep
from .sweep_axis import SweepAxis
from .sweep_check import SweepCheck
from .sweep_point import SweepPoint
from .sweep_point_status import SweepPointStatus
from .sweep_point_verdict_type_0 import SweepPointVerdictType0
from .sweep_request import SweepRequest
from .sweep_request_check import SweepRequestCheck
from .sweep_target import SweepTarget
from .tail_shape import TailShape
from .target_estimate import TargetEstimate
from .target_score import TargetScore
from .unjudged import Unjudged
from .validation import Validation
from .validation_request import ValidationRequest
from .validity import Validity
from .validity_status import ValidityStatus
from .verdict import Verdict
from .verdict_status import VerdictStatus
from .verification import Verification
from .verification_method import VerificationMethod
from .verification_request import VerificationRequest
from .verification_request_method import VerificationRequestMethod
from .version import Version
from .view_check import ViewCheck
from .view_map import ViewMap
from .view_offer import ViewOffer
from .view_search import ViewSearch

__all__ = (
    "Additivity",
    "AimedView",
    "Allowance",
    "AllowanceStatus",
    "Axis",
    "Batch",
    "BatchColumns",
    "BatchPointers",
    "BatchRequest",
    "BatchRequestColumnsItem",
    "BatchRequestTable",
    "BatchWays",
    "BeamAngle",
    "BeamDirection",
    "BiasCompared",
    "BiasComparedIntervalOf",
    "Bounds",
    "Calibration",
    "Certificate",
    "Change",
    "ChangedSpacing",
    "ChangedTolerance",
    "ChangeKind",
    "Check",
    "CheckStatus",
    "Comparison",
    "ComparisonHeadline",
    "ComparisonHeadlineStatus",
    "ComparisonRequest",
    "ComparisonRequestPartsItem",
    "ComparisonTest",
    "ComparisonTestSides",
    "ComparisonTestTest",
    "Contributor",
    "Convergence",
    "ConvergencePoint",
    "Conversion",
    "ConversionFormat",
    "ConversionRequest",
    "ConversionRequestBaseType0",
    "ConversionRequestFormat",
    "ConversionRequestTo",
    "ConversionRequestXmalabType0",
    "ConvertedBody",
    "ConvertedPoint",
    "CountTried",
    "CouplingCase",
    "CouplingCaseCoupling",
    "CouplingCaseReading",
    "Design",
    "DesignPatch",
    "Difference",
    "DifferenceBasis",
    "DifferenceConclusion",
    "DrawnLosses",
    "ErrorDistribution",
    "EstimatorCase",
    "ExampleEntry",
    "ExampleList",
    "Exceedance",
    "Explanation",
    "ExplanationKind",
    "Factor",
    "Finding",
    "FindingSeverity",
    "FrontPoint",
    "FrontPointStatus",
    "Gate",
    "GatedDesign",
    "GatedDesignBasis",
    "GatedDesignVerdict",
    "GateFailLevel",
    "GateFinding",
    "GateFindingSeverity",
    "GateMode",
    "GateNumber",
    "GateNumberStatus",
    "GateOnInconclusiveType0",
    "GateProvenance",
    "GateRequest",
    "GateRequestBaselineType0",
    "GateRequestDesign",
    "GateRequestDesignDesignType0",
    "GateRequestFailLevel",
    "GateRequestMode",
    "GateRequestOnInconclusiveType0",
    "GateRequestPolicyType0",
    "GateRequestWaiversType0",
    "GateRequirement",
    "GateRequirementError",
    "GateRequirementOrigin",
    "GateRequirementSeverity",
    "GateSection",
    "GateTarget",
    "GateVerdict",
    "Geometry",
    "GetOpenapiResponse200",
    "GetReportFormat",
    "GetSchemaDraft",
    "GetSchemaResponse200",
    "Headline",
    "HeadlineStatus",
    "Health",
    "ImagedPoint",
    "ImagedView",
    "Index",
    "InstallationLevel",
    "Job",
    "JobKind",
    "JobLinks",
    "JobPage",
    "JobProgress",
    "JobState",
    "Layout",
    "LayoutRequest",
    "LayoutSceneType0",
    "LevelCompared",
    "LevelRatio",
    "LevelShape",
    "LinearityPoint",
    "LinearityPointErrsType0",
    "LinearityPointStatus",
    "LinearityPointWithinType0",
    "Link",
    "ListJobsKind",
    "ListJobsState",
    "LocalOptimum",
    "Loss",
    "Losses",
    "MeasuredFile",
    "MeasuredFileForm",
    "MetricEstimate",
    "MetricScore",
    "Mixture",
    "MovedFiducial",
    "MovedPivot",
    "NormCompared",
    "Optimisation",
    "OptimisationDesign",
    "OptimisationDesignBefore",
    "OptimisationRequest",
    "OptimisationVerdictStatus",
    "PaperCell",
    "PaperCellQuantity",
    "PaperCellTable",
    "PerUnit",
    "PlacedPoint",
    "PlacementValue",
    "PresetEntry",
    "PresetList",
    "PrintedCell",
    "PrintedCellTable",
    "PrintedCellUnit",
    "Problem",
    "ProblemEntry",
    "ProblemType",
    "Propagation",
    "Provenance",
    "QuantilePoint",
    "Ratio",
    "Readiness",
    "ReadinessDatabase",
    "ReadinessKernels",
    "ReadinessStatusType0",
    "ReadinessStatusType1",
    "Relaxation",
    "Report",
    "ReportDesign",
    "ReportRequest",
    "ReportRequestPartsItem",
    "Reproduction",
    "Reprojection",
    "SchemaEntry",
    "SchemaList",
    "Score",
    "ScoreRequest",
    "SecondOrder",
    "SecondOrderStatus",
    "ShadowPrice",
    "SlipReliability",
    "SpreadCompared",
    "SpreadComparedOf",
    "Statement",
    "StatementAbout",
    "StudyComparison",
    "StudyComparisonError",
    "StudyComparisonRequest",
    "StudyComparisonRequestError",
    "StudyComparisonVerdict",
    "StudyCoupling",
    "StudyCouplingError",
    "StudyCouplingRequest",
    "StudyCouplingRequestError",
    "StudyEstimators",
    "StudyEstimatorsRequest",
    "StudyLinearity",
    "StudyLinearityError",
    "StudyLinearityRequest",
    "StudyLinearityRequestError",
    "StudyPaper",
    "StudyPaperRequest",
    "StudyViews",
    "StudyViewsError",
    "StudyViewsRequest",
    "StudyViewsRequestError",
    "SurvivedLoss",
    "Sweep",
    "SweepAxis",
    "SweepCheck",
    "SweepPoint",
    "SweepPointStatus",
    "SweepPointVerdictType0",
    "SweepRequest",
    "SweepRequestCheck",
    "SweepTarget",
    "TailShape",
    "TargetEstimate",
    "TargetScore",
    "Unjudged",
    "Validation",
    "ValidationRequest",
    "Validity",
    "ValidityStatus",
    "Verdict",
    "VerdictStatus",
    "Verification",
    "VerificationMethod",
    "VerificationRequest",
    "VerificationRequestMethod",
    "Version",
    "ViewCheck",
    "ViewMap",
    "ViewOffer",
    "ViewSearch",
)
