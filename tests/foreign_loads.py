"""Netlists as others write them."""

# As LTspice's users write it: its own suffixes, comments, continuation, params:, .param, model.
DOUBLER = """* charge pump, drawn in LTspice
.PARAM Cpump=1µ  Cout={10*Cpump} ; pump and storage
.model 1N4148x D(Is=2.52n Rs=.568 N=1.752 Cjo=4p M=.4 tt=20n
+ Iave=200m Vpk=75 mfg=OnSemi type=silicon)
.SUBCKT Doubler p n out ref params: Rload=4Meg7
C1 p a {Cpump}
D1 ref a 1N4148x
* a comment between a card
D2 a out
+ 1N4148x $ and its continuation
C2 out ref {Cout} V=50
R1 out ref {Rload} tol=1
R2 ref n 1m
.ENDS
.backanno
.end
"""

# A schematic's netlist, as LTspice writes it.
RECTIFIER = """* C:\\Users\\me\\rectifier.asc
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
