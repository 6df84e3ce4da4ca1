"""GenICam description: XML nodes of the GenApi schema 1.0, one function per kind of feature."""

from __future__ import annotations


def string(name: str, address: int, length: int) -> str:
    """Write a text that is read only, at most `length` bytes."""
    return (
        f'<StringReg Name="{name}" NameSpace="Standard"><Address>{address:#x}</Address>'
        f"<Length>{length}</Length><AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
    )


def integer(name: str, address: int, limits: str = "", access: str = "RW") -> str:
    """Write a whole number in a register; `limits` are nodes such as ``<Min>``."""
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>{limits}</Integer>\n'
        f"{_register(name, address, access)}"
    )


def low_half(name: str, address: int, limits: str) -> str:
    """Write a whole number in the lower 16 bits of a register, bits counted from the highest as the schema does."""
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>{limits}</Integer>\n'
        f'<MaskedIntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></MaskedIntReg>"
    )


def formula(name: str, text: str, **variables: str) -> str:
    """Write a whole number that follows from other features."""
    nodes = "".join(f'<pVariable Name="{letter}">{feature}</pVariable>' for letter, feature in variables.items())
    return f'<IntSwissKnife Name="{name}" NameSpace="Standard">{nodes}<Formula>{text}</Formula></IntSwissKnife>'


def enumeration(name: str, address: int, values: dict[str, int], access: str = "RW") -> str:
    """Write a choice of several names."""
    return (
        f'<Enumeration Name="{name}" NameSpace="Standard">{_entries(values)}<pValue>{name}Register</pValue>'
        f"</Enumeration>\n{_register(name, address, access)}"
    )


def fixed_enumeration(name: str, entry: str) -> str:
    """Write a choice of one name, which cannot be changed."""
    return (
        f'<Enumeration Name="{name}" NameSpace="Standard">{_entries({entry: 0})}<pValue>{name}Value</pValue>'
        f'</Enumeration>\n<Integer Name="{name}Value" NameSpace="Custom"><Value>0</Value></Integer>'
    )


def switch(name: str, address: int) -> str:
    """Write a boolean."""
    return (
        f'<Boolean Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue></Boolean>\n'
        f"{_register(name, address, 'RW')}"
    )


def command(name: str, address: int, value: int) -> str:
    """Write a command that is given by writing `value`."""
    return (
        f'<Command Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>\n{_register(name, address, 'WO')}"
    )


def number(
    name: str, address: int, unit: str, steps_per_unit: float, limits: tuple[float, float], access: str = "RW"
) -> str:
    """Write a number that a register keeps in steps."""
    to_register, from_register = f"FROM * {steps_per_unit}", f"TO / {steps_per_unit}"
    return _converted(name, address, unit, (to_register, from_register), limits, access)


def rate(name: str, address: int, period_limits_us: tuple[float, float]) -> str:
    """Write a rate in Hz of which a register keeps the period in microseconds."""
    low_us, high_us = period_limits_us
    limits = (round(1e6 / high_us, 4), round(1e6 / low_us, 1))
    return _converted(name, address, "Hz", ("1000000 / FROM", "1000000 / TO"), limits, "RW")


def _converted(
    name: str, address: int, unit: str, formulas: tuple[str, str], limits: tuple[float, float], access: str
) -> str:
    return (
        f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Converter</pValue><Min>{limits[0]}</Min>'
        f"<Max>{limits[1]}</Max><Unit>{unit}</Unit></Float>\n"
        f'<Converter Name="{name}Converter" NameSpace="Custom"><FormulaTo>{formulas[0]}</FormulaTo>'
        f"<FormulaFrom>{formulas[1]}</FormulaFrom><pValue>{name}Register</pValue></Converter>\n"
        f"{_register(name, address, access)}"
    )


def _entries(values: dict[str, int]) -> str:
    return "".join(
        f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'
        for entry, value in values.items()
    )


def _register(name: str, address: int, access: str) -> str:
    return (
        f'<IntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></IntReg>"
    )
