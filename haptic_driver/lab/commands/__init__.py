"""The laboratory's commands, one module each.

They join the command line as those of any installed package do: an entry point of
`haptic_driver.commands` names this table.
"""

__all__ = []

PANELS = {
    "Without a rig": {
        "predict": "Predict force, friction and current for a table.",
        "explore": "Draw spectra of force, impedance and friction.",
        "study": "Say how friction and reach spread over a population.",
        "sensitivity": "Say which uncertain number matters most.",
        "reproduce": "Compute figures 4 to 8 of the paper.",
        "contact": "Measure the contact area from a film of the fingerpad.",
        "contact-panel": "Tell contact areas from a panel's capacitive frames.",
        "calibrate-panel": "Calibrate a panel's frames to contact areas of a camera.",
    },
    "On a rig, simulated or real": {
        "safety": "Write a rig's inspection report.",
        "datasheet": "Measure a rig, and write its data sheet of one page.",
        "calibrate-touch": "Calibrate a rig's touch screen.",
        "load tune": "Find the finger's stiffness.",
        "texture import": "Make a texture of what was measured elsewhere.",
        "texture from-image": "Make a texture of a picture.",
    },
    "Record and experiment": {
        "export": "Write recordings or strokes as tables.",
        "fidelity": "Compare felt with asked friction.",
        "scene replay": "Make the scene of a recording again.",
        "experiment": "Run psychophysical experiments, and fit the answers.",
    },
    "When friction is not as the model says": {
        "measure": "Measure friction over a plan's settings.",
        "figure": "Draw friction over displacement and frequency.",
        "rows": "Make rows of measured data of a lab's raw trial files.",
        "diagnose": "Find which effect is missing from the model.",
        "investigate": "Measure and diagnose until the effect has a name.",
        "calibrate": "Fit a finger's own numbers to its data.",
        "challenge": "Make, answer and score sets with hidden effects.",
        "exercise": "Make a course's sealed rigs and data, and mark the answers.",
    },
}
