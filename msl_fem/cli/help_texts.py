"""What the help adds to each command: its group, and examples that can be copied."""

GROUPS = {
    "The magnet": ("draw", "solve", "table", "lookup", "losses", "tolerances"),
    "Operating map": ("map", "guard"),
    "Design": ("size", "flexure", "gap-trade"),
    "Model and records": ("simulate", "bench", "import", "check", "identify", "compare", "diagnose", "calibrate"),
    "Before the bench": ("suspects", "experiments"),
    "Control and other tools": ("control", "loop", "self-sensing", "export"),
    "All in one, and help": ("study", "doctor"),
}
"""Commands as the overview lists them."""

EXAMPLES = {
    "study": ("study servo.toml -o study", "study servo.toml -o study --accuracy fast"),
    "draw": ("draw servo.toml -o section.svg", 'draw servo.toml --gap "0.5 mm" -o section.png'),
    "solve": (
        'solve servo.toml --current "3 A" --gap "0.5 mm" --picture field.png',
        'solve servo.toml --current "3 A" --gap "0.5 mm" --current-2 "1 A" --gap-2 "0.7 mm"',
    ),
    "table": (
        "table servo.toml -o table.nc",
        'table servo.toml --currents "0.5,1,2,4 A" --gaps "0.2,0.4,0.8 mm" --workers 2 -o table.nc',
    ),
    "lookup": ('lookup table.nc --current "3 A" --gap "0.5 mm"',),
    "map": ("map table.nc -o map.json", 'map servo.toml --gaps "0.3,0.5,0.7 mm" --levels "1.2,1.6 T"'),
    "guard": ('guard map.json --current "6 A" --gap "0.7 mm"',),
    "losses": (
        'losses servo.toml --current "2 A"',
        'losses servo.toml --current "2 A" --amplitude "1 A" --frequency "50 Hz" --table table.nc',
    ),
    "size": ("size requirement.toml -o sized.toml --trials 100",),
    "simulate": (
        'simulate servo.toml --excitation "sine:bias=0.6 A,amplitude=50 mA,frequency=20 Hz,duration=1 s" -o run',
        'simulate relay.toml --excitation "step:amplitude=4 V,duration=0.5 s" --locked -o step',
        'simulate relay.toml --excitation "step:amplitude=12 V,duration=0.2 s" --position "-0.8 mm" -o pull_in',
    ),
    "bench": (
        'bench servo.toml --excitation "swept-sine:bias=0.6 A,amplitude=12 mA,start=5 Hz,stop=300 Hz,duration=2 s" '
        "--hide time_delay=3% --seed 7 -o rig",
    ),
    "import": (
        'import log.csv --columns "time_s=t:unit=ms,current_1_A=i:unit=mA,position_m=x:unit=um" '
        "--actuator servo.toml -o record",
        "import scope.csv --propose columns.toml --actuator servo.toml",
    ),
    "check": ("check record", 'check table.csv --labels "position_m,t_on_s"'),
    "identify": ("identify record -o armax.json", "identify record --orders auto --terms auto"),
    "control": (
        'control servo.toml --table table.nc --reference "sine:frequency=2 Hz,amplitude=0.3 mm,duration=1 s"',
        'control servo.toml --table table.nc --design robust --bandwidth "60 Hz" --report loop.html -o loop',
        'control servo.toml --inject "multisine:start=5 Hz,stop=1 kHz,amplitude=2 um,duration=4 s,periods=1" -o held',
    ),
    "loop": ("loop record", "loop record --report loop.html"),
    "self-sensing": (
        "self-sensing servo.toml --table table.nc",
        'self-sensing servo.toml --table table.nc --belief plain --amplitude "10 V" --frequency "2 kHz"',
    ),
    "compare": ("compare record -o comparison",),
    "diagnose": (
        "diagnose record -o diagnosis",
        'diagnose record --effect "drag: force = -a*v*abs(v); a: 0..1 N s2/m2" -o diagnosis',
    ),
    "calibrate": ("calibrate record --records 40",),
    "suspects": ("suspects servo.toml --table table.nc",),
    "experiments": (
        "experiments servo.toml --table table.nc --suspects time_delay,amplifier_bandwidth",
        "experiments diagnosis --instruments position,current,voltage",
    ),
    "export": (
        "export table.nc --to csv -o table.csv",
        "export map.json --to c --what guard -o guard.h",
        "export servo.toml --to fmu -o servo.fmu",
    ),
    "flexure": ("flexure servo_flexure.toml",),
    "gap-trade": ("gap-trade servo.toml --table table.nc",),
    "tolerances": ("tolerances servo.toml -o tolerances",),
    "doctor": ("doctor",),
}
"""Arguments after `msl-fem`, which the tests read by each command's own parser."""


def epilogue(command: str) -> str:
    """The examples of a command as its help shows them, each on a line of its own."""
    lines = "\n".join(f"  msl-fem {example}" for example in EXAMPLES[command])
    return f"\b\nExamples:\n{lines}"
