"""A schematic's netlist becomes a load that says what was rewritten."""

import pytest

from circuits.netlist.imported import candidates, imported
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.cli.command_line import main

NET = """* C:\\Users\\me\\rectifier.asc
V1 N001 N002 SINE(0 5 50)
D1 N001 out DX
D2 0 N001 DX
D3 N002 out DX
D4 0 N002 DX
M1 out g 0 0 NX
R3 g out 10Meg
B1 x 0 V=if(V(out)>3,1,0)
R4 x 0 1k
C1 out 0 10u Rser=0.2
Rload out 0 100k
S1 out a g 0 SX
R1 a 0 100k
.model DX D(Is=1n)
.model NX NMOS(Vto=9)
.model SX SW(Ron=1 Roff=1Meg Vt=50 Vh=-.4)
.tran 1
.backanno
.end
"""


def test_it_becomes_a_load_and_says_what_was_rewritten(tmp_path):
    made = imported(NET, "rectifier", ["N001", "N002", "out", "0"])
    (tmp_path / "rectifier.lib").write_text(made.text)
    load = read_load(tmp_path / "rectifier.lib")
    assert set(load.pins) == {"p", "n", "out", "ref"}
    nodes = {each.name.rpartition(".")[2]: each.nodes for each in load.elements}
    assert "v1" not in nodes
    # The rail: ref was node 0, and a voltage of one node is against it.
    assert "B1 x ref V=if(v(out,ref)>3,1,0)" in made.text
    assert nodes["c1"] == ("out", "ref_c1")
    assert nodes["rser_c1"] == ("ref_c1", "ref")
    assert "* dialect: ltspice" in made.text
    said = "\n".join(made.rewritten)
    for word in ("v1: removed", "Rser_C1", ".tran 1: left out", "dialect: ltspice"):
        assert word.lower() in said.lower()


def test_a_common_node_gets_both_names(tmp_path):
    text = "*\nI1 0 a SINE(0 1m 50)\nD1 a b DX\nR1 b 0 1k\n.model DX D()\n"
    made = imported(text, "half", ["a", "0", "b", "0"])
    (tmp_path / "half.lib").write_text(made.text)
    assert {*read_load(tmp_path / "half.lib").pins} == {"p", "n", "out", "ref"}
    assert "Vcommon ref n 0" in made.text


WITHIN = """*
V1 N001 0 SINE(0 5 50)
.func share(x) {x*V(out)/2}
X1 N001 out cell
B1 out 0 I=share(1u)+I(R1)*1u
R1 out 0 100k
.subckt cell a b
Rc b 0 1Meg
.ends
"""


def test_node_0_within_a_subcircuit_is_refused_where_it_would_be_another():
    # In a load node 0 is the harvester's n: with the nodes the other way round it would be N001.
    with pytest.raises(NetlistError, match=r"Rc in \.subckt cell uses node 0"):
        imported(WITHIN, "a", ["0", "N001", "out", "0"])
    assert "Rc b 0 1Meg" in imported(WITHIN, "a", ["N001", "0", "out", "0"]).text


def test_functions_and_currents_of_resistors_are_rewritten(tmp_path):
    text = WITHIN.replace("Rc b 0", "Rc b a")
    made = imported(text, "a", ["0", "N001", "out", "0"])
    # Against node 0, the harvester's p here, and Ohm's law for the current.
    assert ".func share(x) {x*v(out,p)/2}" in made.text
    assert "I=share(1u)+(v(out,p)/(100k))*1u" in made.text
    assert "B1: I(R1)" in "\n".join(made.rewritten)
    (tmp_path / "a.lib").write_text(made.text)
    read_load(tmp_path / "a.lib")
    with pytest.raises(NetlistError, match=r"share.*cell calls"):
        imported(text.replace("Rc b a 1Meg", "Bc b a I=share(1)"), "a", ["0", "N001", "out", "0"])
    with pytest.raises(NetlistError, match=r"I\(V1\): V1 is removed"):
        imported(text.replace("I(R1)", "I(V1)"), "a", ["0", "N001", "out", "0"])


def test_nodes_are_proposed_and_checked():
    assert candidates(NET)[:2] == ["N001", "N002"]
    with pytest.raises(NetlistError, match="no node N009"):
        imported(NET, "a", ["N001", "N009"])


def test_the_command_writes_it_or_asks(tmp_path, capsys):
    (tmp_path / "r.net").write_text(NET)
    out = tmp_path / "r.lib"
    call = ["load", str(tmp_path / "r.net"), "--output", str(out)]
    assert main([*call, "--nodes", "N001,N002,out,0"]) == 0
    assert "written" in capsys.readouterr().err
    assert out.read_text().startswith("* r, from")
    assert main(call) == 2
    assert "N001, N002" in capsys.readouterr().err


def test_ltspices_own_words_are_taken_and_a_refused_load_is_not_written(tmp_path, capsys):
    said = 'Irms=0 Rser=0.2 Lser=0 Cpar=0 mfg="KEMET" pn="C08 K8" type="X5R"'
    text = NET.replace("10u Rser=0.2", f"10u {said}").replace("D(Is=1n)", 'D(Is=1n mfg="A")')
    source, target = tmp_path / "rectifier.net", tmp_path / "rectifier.lib"
    command = ["load", str(source), "--nodes", "N001,N002,out,0", "--output", str(target)]
    source.write_text(text)
    assert main(command) == 0
    assert read_load(target).has_output
    target.unlink()
    source.write_text(NET.replace("DX D(Is=1n)", "DX ako:DY D(Is=1n)"))
    assert main(command) == 2
    assert "ako: write out" in capsys.readouterr().err
    assert not target.exists()
