"""The catalogue lists the effects that the model may lack, in the order of the chain.

An effect is a small frozen record of a few parameters. It enters the chain at one place, and
changes what one stage passes to the next (`base.py`). A model file switches effects on; the
diagnosis tries those that are off.

Two rules hold. An effect at its off values gives the base model. A new effect is a file of its own
and an entry in this list.
"""

from __future__ import annotations

from model.effects.air_breakdown import AirBreakdown
from model.effects.amplifier_bandwidth import AmplifierBandwidth
from model.effects.amplifier_slew_limit import AmplifierSlewLimit
from model.effects.base import Effect, EffectParameter
from model.effects.capillary_adhesion import CapillaryAdhesion
from model.effects.charge_build_up import ChargeBuildUp
from model.effects.contact_ageing import ContactAgeing
from model.effects.contact_area_law import ContactAreaLaw
from model.effects.drive_gain_error import DriveGainError
from model.effects.electrode_polarization import ElectrodePolarization
from model.effects.electrowetting import Electrowetting
from model.effects.floating_body import FloatingBody
from model.effects.humid_gap_conduction import HumidGapConduction
from model.effects.johnsen_rahbek import JohnsenRahbek
from model.effects.load_dependent_friction import LoadDependentFriction
from model.effects.second_touch import SecondTouch
from model.effects.series_resistance import SeriesResistance
from model.effects.skin_hydration import SkinHydration
from model.effects.skin_nonlinearity import SkinNonlinearity
from model.effects.speed_dependent_gap import SpeedDependentGap
from model.effects.sweat_film import SweatFilm
from model.effects.trapped_charge import TrappedCharge
from model.effects.velocity_dependent_friction import VelocityDependentFriction
from model.effects.viscoelastic_skin import ViscoelasticSkin

CATALOGUE: tuple[type[Effect], ...] = (
    AmplifierBandwidth,
    AmplifierSlewLimit,
    DriveGainError,
    SeriesResistance,
    FloatingBody,
    SkinHydration,
    SkinNonlinearity,
    JohnsenRahbek,
    ElectrodePolarization,
    HumidGapConduction,
    SweatFilm,
    SpeedDependentGap,
    TrappedCharge,
    ChargeBuildUp,
    AirBreakdown,
    CapillaryAdhesion,
    Electrowetting,
    LoadDependentFriction,
    VelocityDependentFriction,
    ContactAgeing,
    ViscoelasticSkin,
    ContactAreaLaw,
)
BY_NAME: dict[str, type[Effect]] = {effect.name: effect for effect in CATALOGUE}

__all__ = [
    "BY_NAME",
    "CATALOGUE",
    "Effect",
    "EffectParameter",
    "SecondTouch",
    "base",
    "drive_gain_error",
    "interventions",
    "learned",
    "skin_hydration",
]
