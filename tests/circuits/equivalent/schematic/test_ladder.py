from circuits.equivalent.schematic.ladder import lay_out
from circuits.netlist.topology import read_topology


def columns(netlist, **pins):
    ladder = lay_out(read_topology(netlist).parts, **pins)
    return {tuple(part.name for part in column.parts): column for column in ladder.columns}, ladder


def test_elements_in_series_share_a_column_with_room_for_each():
    found, ladder = columns("R1 p a 1\nL1 a b 1\nC1 n b 1\nR2 p n 1\n", left=("p", "n"))
    chain = next(names for names in found if len(names) == 3)
    assert set(chain) == {"R1", "L1", "C1"}
    assert found[chain].ends in (("p", "n"), ("n", "p"))
    assert set(ladder.rows) == {"p", "n"}
    assert ladder.rows["p"] - ladder.rows["n"] >= 3


def test_nodes_that_must_be_seen_stay_rails():
    found, ladder = columns("R1 p a 1\nR2 a n 1\n", left=("p", "n"), series=False)
    assert set(found) == {("R1",), ("R2",)}
    assert set(ladder.rows) == {"p", "a", "n"}
    # A transistor's base is named at a rail.
    _, ladder = columns("R1 p a 1\nR2 a n 1\nQ1 p n a model\n", left=("p", "n"))
    assert "a" in ladder.rows


def test_a_loop_to_its_own_rail_is_cut_where_it_can_be_drawn():
    found, _ = columns("V1 a p 1\nS1 a b p n switch\nR1 b p 1\nR2 p n 1\n", left=("p", "n"))
    assert all(column.ends[0] != column.ends[1] for column in found.values())
    assert {name for names in found for name in names} == {"V1", "S1", "R1", "R2"}


def test_ground_is_at_the_bottom():
    _, ladder = columns("R1 0 a 1\nR2 b 0 1\nR3 a b 1\n", series=False)
    assert ladder.rows["0"] == 0
    assert min(ladder.rows["a"], ladder.rows["b"]) == 1
