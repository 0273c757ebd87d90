"""A device with a netlist as load, integrated by compiled code of our own, without ngspice.

This page follows one step of a bridge (`netlists/bridge.lib`) from its netlist to the new state,
and names the function that does each thing. Read the modules in this order.

**Once a scene**

1. `engine.circuit_of` keeps the circuit of a scene. `assembly.build` makes it: the transducer's
   network, then `parts.add_load` for the load. Each kind of element has one function there. They
   call a `builder.Builder`: the bridge's four diodes become rows of its table of junctions, storage
   and resistor become entries of two matrices, C (capacity) and G (conductance).
2. Unknowns are the voltages of all nodes, the currents of branches that set a voltage, and last the
   velocity X'. `builder.tables_of` writes them as arrays, `tables.Tables`. The circuit obeys

       d/dt [C y + q(y)] + G y + i(y) = s(t)

   with the diodes' charges q and currents i, and the sources s.
3. `linear.order_of` chooses the order of elimination. Rows with linear elements alone come first.
   The remaining rows are the core: the nodes of the bridge's diodes, and the velocity.
4. `code.code_of` writes machine code for this shape of circuit: straight lines of arithmetic, no
   loop over elements (`emitter` has the numbers, `elimination` the pivots, `junction` a diode's
   law). Circuits of one shape share their code; values are in a block of memory
   (`memory.Layout`).
5. `mechanics.device_of` compiles spring, damper and contacts, behind addresses, so that a new load
   does not compile the device again.

**Every step** (`stepping.advance` goes from knot to knot of the noise)

1. `stepping._longest`: the longest step that the last error, the sources (`waveform`) and a contact
   allow. Steps are the grid's step divided by a power of two, so that factors can be used again.
2. `stepping._find_step` tries steps until one holds. `stepping._try_step` makes one: TR-BDF2 has
   two implicit stages with the same matrix C + δ G, whose factors `stage.slot_of` keeps for the
   latest two dozen pairs of step and switch states (`code.factor`).
3. For each stage `code.begin` (or `again`) eliminates the linear unknowns from the right-hand side.
   `stage.solve_stage` is Newton's iteration on the core: `mechanics.evaluate` gives the spring's
   and the contacts' force, `code.iterate` puts the diodes' slopes and currents in, eliminates the
   core and moves the junctions' voltages. `stage._linearise` does the same for behavioural sources,
   from `circuits.netlist.expression_graph`. `code.finish` gives the change of all unknowns.
4. `code.conclude` and `code.error` estimate the step's error by an embedded formula of third order.
   Too great an error, a contact entered (`harvester.device.zones`) or a switch that turns
   (`switching.switched`) shortens the step, and it is tried again.
5. `stepping._accept` makes the step's end the state (`code.accept`) and proposes the next length.
   `points.add_points` writes the point: displacement, voltages, and powers whose mean over the step
   is exact, so that the energy balance closes.
6. Near a resonance under a sine, `prewarping.retime` runs the motion's clock a little faster, which
   takes the method's error of frequency away.

A realization's state is `stage.State`. `engine.integrate` hands its points to the estimators, and
names the reason that stopped a run.
"""
