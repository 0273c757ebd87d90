"""A schematic's netlist becomes a load that says what was rewritten."""

import pytest
from foreign_loads import RECTIFIER

from circuits.netlist.imported import candidates, imported
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.cli.command_line import main


def test_it_becomes_a_load_and_says_what_was_rewritten(tmp_path):
    made = imported(RECTIFIER, "rectifier", ["N001", "N002", "out", "0"])
    for end in ("\r\n", "\r"):
        text = RECTIFIER.replace("\n", end)
        assert imported(text, "rectifier", ["N001", "N002", "out", "0"]) == made
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
    assert candidates(RECTIFIER)[:2] == ["N001", "N002"]
    with pytest.raises(NetlistError, match="no node N009"):
        imported(RECTIFIER, "a", ["N001", "N009"])


SAID = """* measure: loss bleeder = V(OUT,0)^2/10Meg
* needs: size > 0
* dialect: ngspice
V1 Vin 0 SINE(0 5 50)
D1 VIN rect DX
R1 rect gnd {size}
R2 Rect out 1k
R3 OUT 0 10Meg
C1 ground 0 1n
R4 ground rect 1Meg
E1 e 0 (out, gnd) 1
R5 e 0 1k
.param size=100k
.model DX D()
.subckt cell a b r=1k
* needs: r > 0
R1 a b {r}
.ends
X1 out 0 cell
"""


def test_comments_that_count_stay_with_the_nodes_of_the_load(tmp_path):
    path = tmp_path / "said.lib"
    path.write_text(imported(SAID, "said", ["0", "vin", "rect", "0"]).text)
    load = read_load(path)
    (measure,) = load.measures
    assert (measure.kind, measure.expression) == ("loss", "v(out_,p)^2/10meg")
    assert path.read_text().count("* dialect:") == 0
    assert path.read_text().count("*dialect: ngspice") == 1
    for words in ("size > 0", "r > 0"):
        path.write_text(imported(SAID, "said", ["0", "vin", "rect", "0"]).text)
        path.write_text(path.read_text().replace(words, "1 < 0"))
        with pytest.raises(NetlistError, match="needs 1 < 0"):
            read_load(path)


def test_nodes_are_compared_without_their_case_and_gnd_is_node_0(tmp_path):
    path = tmp_path / "said.lib"
    path.write_text(imported(SAID, "said", ["0", "vin", "rect", "0"]).text)
    nodes = {part.name: part.nodes for part in read_load(path).elements}
    assert nodes["d1"] == ("n", "out")
    assert nodes["r1"] == ("out", "ref")
    # A node that is called as a pin gets another name.
    assert nodes["r2"] == ("out", "out_")
    assert nodes["e1"] == ("e", "p", "out_", "p")
    # The schematic has a node called as its ground would be.
    other = imported(SAID, "said", ["vin", "e", "rect", "out"]).text
    assert "\nC1 ground ground_ 1n" in other


@pytest.mark.parametrize(
    "line",
    ["R9", "X9", ".model", ".subckt", "Rser=0.2", "A1 0 a b 0 BUF", "K9", ".ends", ".if (a==1)",
     ".global vdd"],
)  # fmt: skip
def test_a_line_that_is_no_statement_is_refused_with_its_text(tmp_path, line):
    path = tmp_path / "a.lib"

    def read():
        path.write_text(imported(WITHIN + line, "a", ["N001", "0", "out", "0"]).text)
        read_load(path)

    with pytest.raises(NetlistError) as refusal:
        read()
    assert line.split()[0].lower() in str(refusal.value).lower()


def test_the_command_writes_it_or_asks(tmp_path, capsys):
    (tmp_path / "r.net").write_text(RECTIFIER)
    out = tmp_path / "r.lib"
    call = ["load", str(tmp_path / "r.net"), "--output", str(out)]
    assert main([*call, "--nodes", "N001,N002,out,0"]) == 0
    assert "written" in capsys.readouterr().err
    assert out.read_text().startswith("* r, from")
    assert main(call) == 2
    assert "N001, N002" in capsys.readouterr().err
    # A refusal names the netlist's line, as the load is not written.
    (tmp_path / "r.net").write_text(RECTIFIER.replace("10u Rser", "10u odd=1 Rser"))
    assert main([*call, "--nodes", "N001,N002,out,0"]) == 2
    assert "r.net:11: C has no parameter 'odd=1'" in capsys.readouterr().err


def test_ltspices_own_words_are_taken_and_a_refused_load_is_not_written(tmp_path, capsys):
    said = 'Irms=0 Rser=0.2 Lser=0 Cpar=0 mfg="KEMET" pn="C08 K8" type="X5R"'
    text = RECTIFIER.replace("10u Rser=0.2", f"10u {said}").replace("D(Is=1n)", 'D(Is=1n mfg="A")')
    source, target = tmp_path / "rectifier.net", tmp_path / "rectifier.lib"
    command = ["load", str(source), "--nodes", "N001,N002,out,0", "--output", str(target)]
    source.write_text(text)
    assert main(command) == 0
    assert read_load(target).has_output
    target.unlink()
    source.write_text(RECTIFIER.replace("DX D(Is=1n)", "DX ako:DY D(Is=1n)"))
    assert main(command) == 2
    assert "ako: write out" in capsys.readouterr().err
    assert not target.exists()
