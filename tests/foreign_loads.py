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
