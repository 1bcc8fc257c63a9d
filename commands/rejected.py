"""The expected no: every reason for refusing a command or a proposal, by its stable code."""

from enum import StrEnum

from ledger.errors import Refused


class Reason(StrEnum):
    """Codes that programs may rely on (ErrorBody.code); the message says which field and why."""

    SCENE_BLANK = "errSceneIdBlank"  # this one and NoSuchRobot are the vendor's own
    SCENE_UNKNOWN = "errSceneNotFound"
    SCENE_DISABLED = "errSceneDisabled"
    SCENE_DISPATCH_PAUSED = "errSceneDispatchPaused"
    SCENE_NAME_INVALID = "errSceneNameInvalid"
    SCENE_NAME_TAKEN = "errSceneNameTaken"
    SCENE_HAS_ORDERS = "errSceneHasOrders"
    SCENE_CONFIG_INVALID = "errSceneConfigInvalid"
    SCENE_CONFIG_UNSUPPORTED = "errSceneConfigUnsupported"
    ORDER_UNKNOWN = "errOrderNotFound"
    ORDER_TERMINAL = "errOrderTerminal"
    ORDER_SEALED = "errOrderSealed"
    ORDER_NO_STEPS = "errOrderNoSteps"
    ORDER_WITHOUT_GOAL = "errOrderWithoutGoal"
    ORDER_SCENE_MISMATCH = "errOrderSceneMismatch"
    ORDER_NOT_FAULTED = "errOrderNotFaulted"
    ORDER_FAULTED = "errOrderFaulted"
    ORDER_ASSIGNED = "errOrderAssigned"
    ORDER_NOT_ASSIGNED = "errOrderNotAssigned"
    ORDER_KIND_INVALID = "errOrderKindInvalid"
    ORDER_LOADED = "errOrderLoaded"
    ORDER_SUSPENDED = "errOrderSuspended"
    EXTERNAL_ID_TOO_LONG = "errExternalIdTooLong"
    PRIORITY_INVALID = "errPriorityInvalid"
    TOO_MANY = "errTooMany"
    FIELD_INVALID = "errFieldInvalid"  # as for what the wire models refuse
    LOCATION_UNKNOWN = "errLocationNotFound"
    LOCATION_IN_USE = "errLocationInUse"
    CONTAINER_TYPE_UNKNOWN = "errContainerTypeNotFound"
    STEPS_MISSING = "errStepsMissing"
    STEP_UNKNOWN = "errStepNotFound"
    STEP_REPEATED = "errStepRepeated"
    STEP_NOT_EXECUTABLE = "errStepNotExecutable"
    STEP_NOT_EXECUTING = "errStepNotExecuting"
    STEP_LOADS_AND_UNLOADS = "errStepLoadsAndUnloads"
    ARGUMENTS_INVALID = "errRbkArgsInvalid"
    BIN_TASK_NEEDS_BIN = "errBinTaskNeedsBin"
    BIN_TASK_UNKNOWN = "errBinTaskNotFound"
    ROBOT_UNKNOWN = "NoSuchRobot"
    ROBOT_NAME_INVALID = "errRobotNameInvalid"
    ROBOT_NAME_TAKEN = "errRobotNameTaken"
    ROBOT_HAS_ORDERS = "errRobotHasOrders"
    ROBOT_NOT_AVAILABLE = "errRobotNotAvailable"
    ROBOT_NOT_WANTED = "errRobotNotWanted"
    ROBOT_BIN_TAKEN = "errRobotBinTaken"
    ROBOT_CONFIG_INVALID = "errRobotConfigInvalid"
    GROUP_UNKNOWN = "errRobotGroupNotFound"
    DOOR_UNKNOWN = "errDoorNotFound"
    LIFT_UNKNOWN = "errLiftNotFound"
    LIFT_AREA_UNKNOWN = "errLiftAreaNotFound"
    DEVICE_DISABLED = "errDeviceDisabled"
    DEVICE_FAULTED = "errDeviceFaulted"
    RESOURCE_OWNER_BLANK = "errExternalMapResOwnerBlank"  # the vendor's own
    RESOURCE_UNITS_EMPTY = "errExternalMapResUnitsEmpty"
    RESOURCE_UNITS_MIXED = "errExternalMapResUnitsMixed"
    RESOURCE_SCENE_ID_DISABLED = "errExternalMapResSceneIdDisabled"
    RESOURCE_SCENE_ID_UNKNOWN = "errExternalMapResSceneIdNotFound"
    RESOURCE_SCENE_NAME_DISABLED = "errExternalMapResSceneNameDisabled"
    RESOURCE_SCENE_NAME_UNKNOWN = "errExternalMapResSceneNameNotFound"
    RESOURCE_NO_SCENE = "errExternalMapResNoSceneEnabled"
    RESOURCE_SEVERAL_SCENES = "errExternalMapResSeveralScenesEnabled"
    RESOURCE_AREA_ID_DISABLED = "errExternalMapResAreaIdDisabled"
    RESOURCE_AREA_NAME_DISABLED = "errExternalMapResAreaNameDisabled"
    RESOURCE_AREA_ID_UNKNOWN = "errExternalMapResAreaIdNotFound"
    RESOURCE_AREA_NAME_UNKNOWN = "errExternalMapResAreaNameNotFound"
    RESOURCE_NO_AREA = "errExternalMapResNoAreaEnabled"
    RESOURCE_SEVERAL_AREAS = "errExternalMapResSeveralAreasEnabled"
    RESOURCE_PLACE_UNKNOWN = "errExternalMapResPointOrPathNotFound"
    RESOURCE_HELD = "errExternalMapResHeld"
    RESOURCE_UNIT_CHANGED = "errExternalMapResUnitChanged"
    RESOURCE_UNIT_EMPTY = "errExternalMapResUnitWithoutResources"
    RESOURCE_ZONE_INVALID = "errExternalMapResZoneInvalid"
    RESOURCE_NOT_PENDING = "errExternalMapResNotPending"
    KEY_INVALID = "errIdempotencyKeyInvalid"
    KEY_REUSED = "errIdempotencyKeyReused"


class Rejected(Refused):
    """A command or a proposal was not accepted, and nothing happened."""

    def __init__(self, reason: Reason, message: str, *args: object) -> None:
        """Take the reason, a sentence that names the field, and the values it speaks of."""
        super().__init__(reason.value, message, *args)
        self.reason = reason
