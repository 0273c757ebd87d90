"""Loads from elsewhere: what LTspice writes is read, and nothing else gets through."""

import codecs
import random
import re

import pytest
from foreign_loads import DOUBLER

from circuits.netlist.subcircuits import find_netlist, load_names, read_load
from harvester.base.errors import NetlistError

LOAD = ".subckt load p n out ref resistance=100k\n{body}\nR1 out ref {{resistance}}\n.ends\n"


def read(tmp_path, text, **arguments):
    path = tmp_path / "load.lib"
    path.write_text(text, encoding="utf-8")
    return read_load(path, **arguments)


def test_ltspices_spelling_is_read_as_it_is_meant(tmp_path):
    load = read(tmp_path, DOUBLER)
    assert load.pins == ("p", "n", "out", "ref")
    assert [each.name for each in load.across_output] == ["c2", "r1"]
    assert not load.linear
    assert not load.switches
    assert "rload=4.7meg" in load.text
    assert ".param cpump=1u\n" in load.text
    model = re.search(r"\.model.*", load.text).group()
    assert "tt=20n" in model
    assert "mfg" not in model
    assert "iave" not in model


def test_a_byte_order_mark_before_another_encoding_is_no_character(tmp_path):
    text = "* 1 µF\n" + LOAD.format(body="R2 p n 2k")
    (tmp_path / "load.lib").write_bytes(codecs.BOM_UTF8 + text.encode("cp1252"))
    assert read_load(tmp_path / "load.lib").name == "load"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "cp1252"])
def test_any_encoding_that_ltspice_writes(tmp_path, encoding):
    (tmp_path / "load.lib").write_bytes(DOUBLER.replace("\n", "\r\n").encode(encoding))
    assert ".param cpump=1u\n" in read_load(tmp_path / "load.lib").text


def test_a_series_resistance_of_zero_is_none(tmp_path):
    load = read(tmp_path, LOAD.format(body="C7 p n 1u V=6.3 Irms=0 Rser=0 Lser=0"))
    assert "c7 p n 1u\n" in load.text


def test_parameters_reach_the_sub_circuit_and_the_files_own(tmp_path):
    load = read(tmp_path, DOUBLER, parameters={"Rload": "100k", "cpump": 2e-6})
    assert load.parameters == (("rload", 1e5),)
    assert ".param cpump=2e-06\n" in load.text


def test_a_single_resistor_is_known_as_one(tmp_path):
    assert read_load(find_netlist("resistor")).resistance == 1e5
    assert read_load(find_netlist("resistor"), parameters={"resistance": "4k7"}).resistance == 4700
    two = ".subckt load p n\nR1 p x 1k\nR2 x n 1k\n.ends\n"
    assert read(tmp_path, two).resistance is None


def test_every_load_of_the_library_is_read():
    for name in load_names():
        load = read_load(find_netlist(name))
        assert {"p", "n"} <= {*load.pins}


def test_includes_beside_the_file_and_below(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "diode.lib").write_text(".inc more.lib\n.model d1 d(is=1n)\n")
    (tmp_path / "parts" / "more.lib").write_text(".model d2 d(is=2n)\n")
    for how in ('.include "parts/diode.lib"', ".INC parts/diode.lib", ".lib 'parts/diode.lib'"):
        text = read(tmp_path, how + "\n" + LOAD.format(body="D1 p out d1\nD2 n out d2")).text
        assert ".model d2 d(is=2n)" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (".include ../secret.lib", "outside"),
        (".include /etc/passwd", "outside"),
        (".include ~/secret.lib", "outside"),
        (".include C:\\secret.lib", "outside"),
        (".include link.lib", "outside"),
        (".include sub/link/secret.lib", "outside"),
        (".include missing.lib", "no such file"),
        (".lib parts.lib fast", "section"),
        (".include load.lib", "includes itself"),
    ],
)
def test_includes_stay_in_the_loads_folder(tmp_path, line, message):
    folder = tmp_path / "load"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "secret.lib").write_text(".model d d\n")
    (folder / "link.lib").symlink_to(tmp_path / "secret.lib")
    (folder / "sub" / "link").symlink_to(tmp_path)
    with pytest.raises(NetlistError, match=message):
        read(folder, line + "\n" + LOAD.format(body="R2 p n 1k"))


@pytest.mark.parametrize(
    "line",
    [
        ".control\nshell touch owned\n.endc",
        ".exec touch owned",
        "*# shell touch owned\n.csparam a=1",
        ".save all", ".print tran v(p)", ".plot tran v(p)", ".tran 1 2", ".op", ".dc v1 0 1 1",
        ".options gmin=1", ".measure tran a max v(p)", ".meas tran a max v(p)",
        ".wave out.wav v(p)",
        ".write file", ".global x", ".ic v(p)=1", ".nodeset v(p)=1", ".hdl 'x.va'", ".title x",
        ".pre_osdi x.osdi", ".codemodel x.cm", ".if (1)", ".step param a 1 2 1", ".temp 3",
        "A1 p n filesrc", "a1 %v([p n]) src\n.model src filesource(file=\"x\")",
        "A1 [p] [n] null proc\n.model proc d_process(process_file=\"sh\")",
        "V1 p n PWL file=/etc/passwd", "V1 p n wavefile=x.wav", "V1 p n external",
        "I1 p n external", "I1 p n dc 0 external", "V1 p n trnoise(1 1 1 1)", "V1 p n 'sh'",
        "V1 p n trrandom(1 1 1)", "N1 p n model", "Y1 p n model", "U1 p n model", "O1 p n model",
        "T1 p 0 n 0 z0=50", "P1 p n model", "Z1 p n model", "shell touch owned",
        "source x", "quit", "R2 p n `id`", "R2 p n $HOME", "R2 p n \"x\"", "R2 p n 1k\\",
        "R2 p n 1;\n+ .control", ".model src filesource(file=x)", ".model d d(file=x)",
        "E1 p n poly(1) out ref 0 1", "E1 p n out ref table(1)", "E1 p n laplace {v(p)} {1/s}",
        "B1 p n i=gauss(1)", "B1 p n i=v(p", "B1 p n i=v(p))", "B1 p n i=@r1[i]", "B1 p n",
        "B1 p n i=1 ? 2", "R2 p n {1+}", "R2 p n {(1}", "R2 p n {1", "R2 p n 1}", "R2 p n {}",
        "R2 p n {agauss(1,1,1)}", "R2 p n {x}", "R2 p n nan", "R2 p n inf", "R2 p n 1e999",
        "R2 p n", "R2 p", "R2", "C1 p n 1u Rser=1", "C1 p n 1u file=3", "L1 p n 1m Rser=1",
        "D1 p n", "D1 p n nomodel", "D1 p n d\n.model d d(vfwd=0.4)", "Q1 p n out", "K1 L1 0.9",
        ".model d d(is=x)", ".model d d(is=1n", ".model d a2d()", ".model d ako:x d(is=1)",
        ".model sw sw(ilimit=1)", ".func f(x {x}", ".func f(x) {y}", ".param a", ".param a={b}",
        "R2 p n {" + "x." * 120 + "}", "X1 " + "n#" * 500 + " p load",
        "X1 p n", "X1 p n nothing", "X1 p n load", "X1 p n out ref load", "X1 p n out ref load r=1",
        ".subckt a\n.ends", ".subckt 0 p\n.ends", ".subckt a p p\nR1 p x 1\n.ends", ".subckt a p 0",
        ".subckt load2 p n", ".ends other", "é", "R2 p n 1 kΩ", "\x07",
    ],
)  # fmt: skip
def test_what_is_no_load_is_refused_in_one_line(tmp_path, line):
    with pytest.raises(NetlistError) as refusal:
        read(tmp_path, LOAD.format(body=line))
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 250
    assert "load.lib" in str(refusal.value)


def test_a_plus_alone_continues_with_nothing(tmp_path):
    plain = read(tmp_path, LOAD.format(body="R2 p n 2k"))
    assert read(tmp_path, LOAD.format(body="R2 p n\n+\n+ 2k\n+")).text == plain.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no .subckt"),
        (".subckt load p n\nX1 p n bat54\n.ends\n", "no .subckt bat54: copy it into the file"),
        ("R1 p n 1k\n", "outside a .subckt"),
        ("My rectifier\n.subckt load p n\nR1 p n 1k\n.ends\n", "a title begins with *"),
        (".subckt load p n\nR1 p n 1k\n.ic v(p)=1\n.ends\n", "write ic= after the capacitor"),
        (
            ".subckt load p n\nL1 p n 1\nL2 n 0 1\nK1 L1 L3 0.9\n.ends\n",
            "load.lib:4: k1: no inductor l3",
        ),
        (
            ".subckt load p n\nL1 p n 1\nL2 n 0 1\nK1 L1 L2 1.1\n.ends\n",
            "load.lib:4: k1: coupling 1.1",
        ),
        ("+ 1k\n", "continues no statement"),
        (".subckt load p n\nR1 p n 1k\n", "without .ends"),
        (".ends\n", "without a .subckt"),
        (".subckt load a b\nR1 a b 1k\n.ends\n", "expected p n, or p n out ref"),
        (".subckt load p n out\nR1 p n 1k\n.ends\n", "expected p n, or p n out ref"),
        (".subckt load p n out ref x\nR1 p n 1k\n.ends\n", "expected p n, or p n out ref"),
        (".subckt load p n out ref\nD1 p out d\n.model d d\n.ends\n", "no resistor or capacitor"),
        (".subckt load p n out ref\nR1 out ref {1+v(p)}\n.ends\n", "constant value"),
        (".subckt a p n\nR1 p n 1\n.ends\n.subckt b p n\nR1 p n 1\n.ends\n", "choose one by"),
        (".subckt a p n\nX1 p n b\n.ends\n.subckt b p n\nX1 p n a\n.ends\n", "contains itself"),
        (".subckt a p n\nR1 p n 1\n.ends\n.subckt a p n\nR1 p n 1\n.ends\n", "twice"),
    ],
)
def test_files_that_hold_no_load(tmp_path, text, message):
    arguments = {"subcircuit": "a"} if "itself" in message else {}
    with pytest.raises(NetlistError, match=re.escape(message)):
        read(tmp_path, text, **arguments)


def test_names_that_are_not_there_are_answered_with_the_nearest(tmp_path):
    with pytest.raises(NetlistError, match="did you mean resistor"):
        find_netlist("resistr")
    with pytest.raises(NetlistError, match="no such file"):
        find_netlist("missing.lib", (tmp_path,))
    with pytest.raises(NetlistError, match="did you mean doubler"):
        read(tmp_path, DOUBLER, subcircuit="dobler")
    with pytest.raises(NetlistError, match="did you mean rload"):
        read(tmp_path, DOUBLER, parameters={"rlod": 1.0})
    # The last one takes a minute where a pattern tries every way to part the digits.
    for value in ("abc", float("nan"), float("inf"), "1e999", "", "1" * 100_000 + "-"):
        with pytest.raises(NetlistError, match="finite number") as refusal:
            read(tmp_path, DOUBLER, parameters={"rload": value})
        assert len(str(refusal.value)) < 250
    for name in ("x" * 5000 + ".lib", "a\0.lib"):
        with pytest.raises(NetlistError, match="no such file"):
            find_netlist(name, (tmp_path,))


def test_calls_that_multiply_are_refused_before_they_fill_the_memory(tmp_path):
    levels = [".subckt load p n\nX0 p n s0\nX1 p n s0\n.ends"]
    for k in range(12):
        levels.append(f".subckt s{k} p n\nX1 p n s{k + 1}\nX2 p n s{k + 1}\n.ends")
    levels.append(".subckt s12 p n\nR1 p n 1k\n.ends\n")
    with pytest.raises(NetlistError, match="elements"):
        read(tmp_path, "\n".join(levels))


@pytest.mark.slow
def test_whatever_is_broken_in_a_file_it_is_refused_by_name(tmp_path):
    """Seeded damage: a load or a NetlistError, never another exception."""
    generator = random.Random(1)
    pieces = [*"+*.;{}()='\"$ \n\tR", "0", ".ends", ".subckt", "params:", "=", "é", "\0", "-", "e"]
    refused = []
    for _ in range(500):
        text = list(DOUBLER)
        for _ in range(generator.randint(1, 4)):
            place = generator.randrange(len(text))
            text[place : place + generator.randint(0, 5)] = generator.choice(pieces)
        try:
            read(tmp_path, "".join(text))
        except NetlistError as error:
            refused.append(str(error))
    assert len(refused) > 150
    assert not any("\n" in message for message in refused)


def test_a_load_is_told_apart_by_its_text_and_values():
    values = [{}, {"resistance": 1e5 + 1.0}, {"storage": 1e-6}]
    digests = [read_load(find_netlist("bridge"), None, each).sha256 for each in values]
    digests.append(read_load(find_netlist("doubler")).sha256)
    assert len({*digests}) == 4
    assert digests[0] == read_load(find_netlist("bridge")).sha256


@pytest.mark.parametrize("ground", ["0", "gnd", "GND"])
def test_a_pin_that_is_spices_ground_is_refused_with_what_to_do(tmp_path, ground):
    path = tmp_path / "load.lib"
    path.write_text(f".subckt shunt p {ground}\nR1 p {ground} 1k\n.ends\n")
    with pytest.raises(NetlistError, match=r"SPICE's ground, .*: rename it here and in the body"):
        read_load(path)
