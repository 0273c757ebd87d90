# ruff: noqa: E501
"""Loads of `make netlists`: random netlists over what docs/loads.md names, and vendors' models.

Templates: `<low:high>` is a number in a random spelling, `<a|b>` one of the texts, `#` a number of
the part's own, and `$` stands for a dimensionless voltage, v(p,n)/20 or v(out,ref)/5.
"""

import math
import re

import numpy as np

# Elements between p, n (0), a (behind a resistor of some kΩ), out and ref.
PARTS = [
    "R# a n <2e4:1e6>", "R# a n R=<2e4:1e6> m=<2|3|0.5>", "R# a n <2e4:1e5> tc1=<1e-3:8e-3> temp=<40|77|-20>",
    "R# a n <2e4:1e5> tc=<1e-3:8e-3>,<1e-6:1e-5> dtemp=<30:60> scale=<2|0.5>", "R# a n <2e4:1e5> tce=<0.1:1> temp=50",
    "R# a n rm# l=<20u|0.1m> w=<2u|5u>\n.model rm# r(rsh=<1k|5e3> narrow=0.1u)", "R# a n rm# tc1=<1m|2e-3>\n.model rm# <r|res>(<r|res>=<3e4:2e5> tnom=20)",
    "R# a n <2e4:1e5> rm#\n.model rm# r(tc1=<1m|5m> tc2=1e-5 tnom=<0|50>)", "R# a n {<2e4:1e5>*(1+abs($))}", "R# a n '<2e4:1e5>/(1+$*$)'",
    "C# a n <1e-9:3e-8>", "C# a n <1e-9:3e-8> ic=<-5|2|0.5>", "C# a n cm# m=2\n.model cm# c(cap=<1e-9:1e-8> tc1=1m tnom=0)", "C# a n C=<1e-9:1e-8> tc1=<1m|-1m> temp=60",
    "C# a n cm# l=<20u|50u> w=<20u|30u>\n.model cm# c(cj=<1|5> cjsw=<1u|1e-5> narrow=1u)", "C# a n C='<1e-9:1e-8>*(1+0.5*tanh($))'", "C# out ref <1e-8:1e-7> ic=<0.5|2>",
    "L# a x# <20:300>\nR# x# n <2e4:1e5>", "L# a x# <20:300> ic=<1u|-20u>\nR# x# n <2e4:1e5>", "L# a x# lm# m=2 tc1=1m temp=50\n.model lm# l(ind=<50:200>)\nR# x# n <2e4:1e5>",
    "L# a n <50:300>\nL2# s# n <50:300>\nK# L# L2# <0.5|0.9|{0.99}>\nR# s# n <2e4:1e5>", "L# a n 100\nLb# s# n 50\nLc# t# n 20\nK1# L# Lb# 0.8\nK2# L# Lc# 0.7\nK3# Lb# Lc# 0.6\nR# s# n <2e4:1e5>\nRt# t# n <2e4:1e5>",
    "D# a out dm#\n<DIODE>", "D# a x# dm# area=<2|0.5> temp=<50|-10>\n<DIODE>\nR# x# n <1e4:1e5>", "D# n a dm# m=<2|4> dtemp=20\n<DIODE>", "D# a out dm# <2|3> off\n<DIODE>",
    "D# n x# dm#\nR# x# a <1e4:5e4>\n.model dm# d(is=<1e-15:1e-9> bv=<4.7:15> <ibv=1m|ibv=10u nbv=1.5|> rs=<1:30> cjo=<1e-11:2e-10>)",
    "S# a x# out ref sm# <on|off|>\nR# x# n <1e4:1e5>\n.model sm# sw(vt=<0.5|1|2> vh=<0.1|0.3|0> ron=<1|100|1k> roff=<10meg|1g>)", "S# a x# p n sm#\nR# x# n <1e4:1e5>\n.model sm# sw(vt=<0|3|-4> vh=<1|0.5> ron=10 roff=100meg)",
    "Vm# a y# 0\nRv# y# n <2e4:1e5>\nW# a x# Vm# wm# <on|off|>\nR# x# n <1e4:1e5>\n.model wm# csw(it=<10u|-30u|50u> ih=<1u|5u> ron=100 roff=10meg)",
    "S# a x# p n sm#\nR# x# n <1e4:1e5>\n.model sm# <sw(vt=2 vh=-1|vswitch(von=4 voff=1|vswitch(von=-2 voff=3|sw(vt=0 vh=-3> ron=<100|1k> roff=<1meg|20meg>)",
    "V# x# n <sin|SINE>(<0|1> <1:10> <20:200> <0|2m> <0|5> <0|45>)\nR# x# a <2e4:1e5>", "V# x# n pulse(<0|-2> <5|3> <1m|0> <10u|1m> <20u|2m> <5m|8m> <20m|15m>)\nR# x# a <2e4:1e5>", "I# ref out dc <1u:30u>",
    "V# x# n exp(0 <3:10> <2m|5m> <1m|4m> <30m|50m> <5m|10m>)\nR# x# a <2e4:1e5>", "I# n a sffm(0 <10u:50u> <50:150> <1|3> <10|20>)", "I# n a pwl(0 0 10m <1u:50u> 20m <0:30u> 50m -<1u:20u>)", "V# x# n pwl(0 0,5m 5,6m <1|2>,40m 7) <td=5m|>\nR# x# a <2e4:1e5>",
    "V# x# n <dc 3|5|3 ac 1|DC=2>\nR# x# a <2e4:1e5>", "E# x# n a n <0.5|-1|2>\nR# x# a <2e4:1e5>", "E# x# n <vol|VALUE>={<3:8>*tanh($)}\nR# x# a <2e4:1e5>", "E# x# n VALUE {<3:8>*sin($)}\nR# x# a <2e4:1e5>",
    "G# a n a n <1u:20u> <m=2|>", "G# a n cur='<1u:30u>*$'", "G# a n (p,n) <1u:20u>", "Vf# a y# 0\nR# y# n <2e4:1e5>\nF# a n Vf# <0.5|2> <m=2|>", "Vh# a y# 0\nR# y# n <2e4:1e5>\nH# x# n Vh# <1k|20k>\nRh# x# out <5e4:2e5>",
    "Vb# a y# 0\nR# y# n <2e4:1e5>\nB# a n i=0.3*i(Vb#)*abs($)", "B# x# n v=<2:8>*<FUNCTION>\nR# x# a <2e4:1e5>", "B# a n i=<5u:40u>*<FUNCTION>", "B# n out i=<1u:5u>*<FUNCTION>", "B# a n i=<5u:40u>*<FUNCTION>*<FUNCTION> <m=2|>",
    "X# a n sub# <r=|params: r=><2e4:1e5>\n.subckt sub# x y r=1k c=<1e-9:1e-8>\nR1 x m {r}\nC1 m y {c/2}\nX2 m y in k=2\n.subckt in u w k=1\nR1 u w {k*<2e4:1e5>}\n.ends\n.ends",
    "X# a n sub#\n.subckt sub# x y\n.param q=<1.5|2k/1k> z={q*<1e4:5e4>}\n.func f(a,b) {a*b+<1k|2k>}\nR1 x y {f(z,q)}\n.ends", "B# a n i=f#($,2)*<1u:9u>\n.func f#(x,y) {x*y/(1+x*x)}", "R# a n {w#}\n.param w#=<2e4:1e5>",
    "R# a n {<2e4:1e5>*<CONSTANT>}", "B# a n i=<5u:20u>*ddt($)*1m", "B# a n i=<5u:20u>*pwl($,-2,-1,0,0,1,<1|2>,3,1)", "Q# x# b# n qm#\nRb# a b# 1meg\nR# x# out <1e5:5e5>\n.model qm# npn(is=1e-14 bf=<50|200>)",
    "J# a n x# jm#\nR# x# n <1e4:1e5>\n.model jm# njf(vto=-2 beta=<1m|1e-4>)", "M# a n n n mm# w=<10u|100u> l=<1u|2u>\n.model mm# nmos(level=1 vto=<1|2> kp=<20u|50u>)", "B# a n i=<1u:20u>*$*exp(-time/<20m|50m>)", "B# a n i=(time><20m|35m>) ? <1u:30u>*$ : 0",
]  # fmt: skip
DIODE = ".model dm# d(is=<1e-15:1e-7> n=<1|1.05|1.8> <rs=<1:50>|> <cjo=<1e-12:1e-10> vj=<0.4|0.7> m=<0.33|0.5> fc=0.6|> <tt=5n|> <ikf=<1e-4:1e-2>|> <isr=<1e-10:1e-9> nr=2|> <bv=100|> <eg=0.69 xti=2|> <trs1=1m tnom=25|> <mfg=X type=silicon|>)"
# Of everything that docs/loads.md and the reader's own table name, kept about 1 and in range.
FUNCTIONS = """
abs($) acos(0.9*tanh($)) acosh(1+$*$) arctan($) asin(0.9*tanh($)) asinh($) atan($) atanh(0.9*tanh($)) buf($) ceil($) cos($)
cosh(tanh($)) exp(tanh($)) floor(2*$) hypot($,1) if($>0.5,$,0.5) int(3*$) inv($) limit($,-0.5,1) ln(1+abs($)) log(1+$*$)
log10(1+abs($)) max($,0.2) min($,0.2) nint(2*$) pow(abs($),1.5) pow($,2) pwr($,3) pwrs($,0.5) round(2*$) sgn($-0.3) sin(2*$)
sinh(tanh($)) sqr($) sqrt(abs($)) stp($-0.2) tan(tanh($)) tanh(2*$) ternary_fcn($>0.1,$,-$) u($-0.1) u2($) uramp($)
($)**2 ($)^3 (abs($))**1.5 (-$) ($>0.2)*$ ($<=0.3?1:-$) ($>0.1&&$<0.9) ($<-0.5||$>0.5) (!($>0.4)) ($>=0.2)-($!=0.5)
($/(1+$*$)) (2*$-3*$/(2+abs($))) (1-$*$/4) ($-2<$*$?$:1) (5m*200*$) (0.001k*$) (1e3*$/1k) (4k7*$/4.7k) idt($) atan2($,1) table($,0,0,1,1)
(($>0.3)^($>0.6)) ($>0.3&$<0.6) (~($>0.3)) ($==$) (v(p,n)*v(out,ref)/200) (sin(2*pi*60*time)*$) (temper/27*$) (($>0.5)==($>0.1)) nofunction($)
""".split()  # fmt: skip
CONSTANTS = "pi e/2 exp(0.5) sqrt(2) (3>2) 2**0.5 2^1.5 (5%3) max(1,2) int(1.7) nint(1.6) pow(2,0.5) pwr(2,0.5) min(2,3k) (1?2:3) log10(50) ln(5) floor(1.5) 1e3/1k 25.4u/1mil boltz/1.38e-23 echarge/1.6e-19 (-kelvin/273) temper/27 c/3e8 abs(-1.2) sgn(3) (1&&1) hypot(1,1) if(1,2,3) acos(0.3) atan(1) exp(80)/exp(79) 2-1 .5 1.5E0".split()  # fmt: skip
FRONTS = [
    "D1f p out dmf\nRf ref n 10\nRr a p <1e3:1e4>", "D1f p out dmf\nD2f ref p dmf\nD3f n out dmf\nD4f ref n dmf\nRr p a <1e3:1e4>",
    "Cf p m 100n\nD1f ref m dmf\nD2f m out dmf\nRf n ref 10\nRr p a 1k", "Rf ref n 1\nRr p a <1e3:5e4>\nRs a out <1e5:1e6>", "Lf p a <1:20>\nD1f a out dmf\nRf ref n 10", "V0 ref n 0\nE0 out ref p n 0.2\nRr p a 5k",
]  # fmt: skip
FRONT_DIODE = ".model dmf d(is=<1n|30n|2e-14> n=<1|1.05> rs=<2|10> <cjo=20p|>)"
# Vendors' ways of writing their parts; {} of the circuit around them are X or elements that use it.
VENDORS = [
    # Diodes in LTspice's, PSpice's and manufacturers' lists of parameters.
    "D# a out V#\n.model V# D(Is=<1e-12:1e-8> N=<1.7|1.9> Rs=<0.5:5> Cjo=<1e-12:8e-12> M=<.33|.4> Vj=<.5|.75> tt=<2e-8|5n> Iave=200m Vpk=75 mfg=OnSemi type=silicon)",
    ".MODEL V# D\n+ (\n+ IS = <1e-9:1e-6>\n+ N = 1.04\n+ BV = <30|40>\n+ IBV = <1E-5|1e-4>\n+ RS = <0.1:2>\n+ CJO = <1E-11:1E-10>\n+ VJ = 0.<35|6>\n+ M = 0.<45|3>\n+ FC = 0.5\n+ TT = 0\n+ EG = 0.69\n+ XTI = 2\n+ )\nD# a out V#",
    "D# n a V#\nRz# a out 1meg\n.model V# D(Is=<1.4n|5f> Rs=<1:20> Bv=<3.6:18> Ibv=<1m|5m> Nbv=<1|1.6> Cjo=<50p|150p> type=Zener mfg=Vishay Vpk=5.6)", "D# a x# V#\nR# x# n <1e4:5e4>\n.model V# D(Is=<1e-19:1e-16> N=<2|2.2> Rs=<2|8> Cjo=42p Iave=30m Vpk=5 type=LED)",
    "X# n a V#\n.SUBCKT V# 1 2\nD1 1 2 DF\nDZ 3 1 DR\nVZ 2 3 <3.4:8>\n.MODEL DF D ( IS=<1e-15:1e-12> RS=<1|20> N=1.10 CJO=<9e-11|5e-11> VJ=0.75 M=0.33 TT=50.1n )\n.MODEL DR D ( IS=<1e-16:1e-14> RS=<5|30> N=<1.5|3> )\n.ENDS", "D# a out V#\n.model B# d(is=<1e-10:1e-8> rs=<1|5> n=1.1 cjo=10p)\n.model V# ako:B# d(rs=10)",
    "D# a x# V#\nR# x# n <1e4:5e4>\n.model V# D(Ron=<0.1|1> Roff=1G Vfwd=0.<3|4>)", "X# a out V# <PARAMS: is=|is=><1e-9:1e-8>\n.SUBCKT V# A K PARAMS: is=1n n=1.05\nD1 A K D1\nR1 A K <1e8:1e9>\nC1 A K <1p|20p>\n.MODEL D1 D(IS={is} N={n} RS=2)\n.ENDS V#", "D# a out V#\n.MODEL V# D(IS=<1e-9:1e-7> RS=1 IKF=<1|20m> CJO=1e-11 ISR=<1e-9:1e-8> NR=<1.8|2> LEVEL=1 TT=1n Trs1=<1m|0> TBV1=0.001 AF=1 KF=0)",
    # MOSFETs: VDMOS of LTspice, sub-circuits of manufacturers.
    "M# x# g# n n V#\nR# x# a <2e4:1e5>\nVg# g# n pulse(0 5 2m 10u 10u 6m 15m)\n.model V# VDMOS(Rg=3 Vto=<1:2.5> Rd=<14m|1> Rs=<10m|1> Rb=17m Kp=<1|30> Lambda=0.<01|1> Cgdmax=<1n|0.1n> Cgdmin=50p Cgs=<0.3n|1n> Cjo=<0.1n|1n> Is=88p ksubthres=.1 mfg=X Vds=30 Ron=10m Qg=5n)",
    "X# x# g# n V#\nR# x# a <2e4:1e5>\nVg# g# n <dc 5|pulse(0 5 3m 20u 20u 5m 15m)>\n.SUBCKT V# D G S\nM1 3 GX S S NM L=2u W=<100u|1m>\nM2 S GX S D PM L=1u W=100u\nR1 D 3 RT <1:100>\nRG G GX 15\nCGS GX S <50p|300p>\nRB 2 S RT 1\nDB S D DBD\n.MODEL NM NMOS (LEVEL=<1|3> TOX=5E-8 RS=2 KP=<1.5e-5|3e-5> NSUB=<1e17|5e16> VTO=<1|2>)\n.MODEL PM PMOS (LEVEL=3 TOX=5E-8 NSUB=3e16 TPG=-1)\n.MODEL DBD D (CJO=<20p|100p> VJ=0.38 M=0.4 IS=1p BV=60 RS=1 TT=100n)\n.MODEL RT RES (TC1=<7m|1m> TC2=5.5u)\n.ENDS",
    "M# a a n n V# L=1u W=<10u|200u> AD=100p AS=100p PD=40u PS=40u\n.MODEL V# NMOS (LEVEL=<1|2|3> VTO=<0.8|2> KP=<20u|100u> GAMMA=0.<4|6> PHI=0.65 LAMBDA=0.02 TOX=<40n|20n> CGSO=0.2n CGDO=0.2n CJ=0.3m MJ=0.5 CJSW=0.3n RSH=10)", "M# out g# x# out V# l=2u w=<50u|100u>\nRg# g# out 1meg\nRh# g# ref <1e6:3e6>\nR# x# ref <5e4:2e5>\n.model V# pmos(level=1 vto=-<0.5|1> kp=10u)",
    # BJTs with full Gummel-Poon lists.
    "Q# x# b# n V#\nRb# a b# <1e5:1e6>\nR# x# a <2e4:1e5>\n.MODEL V# NPN(IS=<1e-15:2e-14> BF=<100:400> NF=1 VAF=<70|100> IKF=0.<1|3> ISE=<6.7e-15|1e-14> NE=1.<26|5> BR=<0.7|6> NR=1 VAR=<20|100> IKR=0 ISC=0 NC=2 RB=10 RE=0.1 RC=1 CJE=<4.5p|25p> VJE=.75 MJE=.26 CJC=<3.6p|8p> VJC=.75 MJC=.31 FC=.5 TF=<300p|400p> TR=240n XTB=1.5 XTI=3 EG=1.11 Vceo=40 Icrating=200m mfg=NXP)",
    "Q# x# b# out V#\nRb# b# ref <1e5:1e6>\nR# x# ref <2e4:1e5>\n.model V# pnp(is=<1e-15:1e-14> bf=<80|180> vaf=18.7 cje=8p cjc=9p tf=180p rb=10 rc=2.5 re=0 ikf=80m xtb=1.5 ise=0 br=5)", "X# a n V#\n.subckt V# 1 2\nQ1 1 3 2 QX\nR1 1 3 <1e5:1e6>\nD1 2 1 DX\n.model QX ako:QY NPN(bf=200)\n.model QY NPN(is=1e-14 bf=100)\n.model DX D(is=1n)\n.ends",
    "J# a g# n V#\nRg# g# n 1meg\n.model V# NJF(Beta=<1m|0.5m> Betatce=-.5 Rd=1 Rs=1 Lambda=<2m|20m> Vto=-<1:3> Is=33f Cgd=<1.6p|5p> Cgs=2.4p Fc=.5 Pb=1 mfg=Siliconix)",
    # Regulators, references and supervisors as behavioural sub-circuits.
    "X# out ref y# V#\nR# y# ref <1e5:5e5>\n.SUBCKT V# IN GND OUT PARAMS: VOUT=<1.2|1.8> RO=<10|100> IQ=<0.5u|1u>\nE1 1 GND VALUE={MIN(VOUT,MAX(0,V(IN,GND)-0.1))}\nR1 1 OUT {RO}\nG1 IN GND VALUE={IQ*TANH(V(IN,GND))}\nG2 IN GND VALUE={V(1,OUT)/RO}\n.ENDS", "X# out y# ref V#\nR# y# ref <1e5:3e5>\n* dialect: ltspice\n.subckt V# in out com\n.param Vo=<1|1.5> g=<1m|0.1m>\nB1 in out I=g*limit(Vo-V(out,com),0,V(in,out)) Rpar=1G\nC1 out com <1n|10n> Rser=<0|1>\n.ends",
    "X# out y# ref V#\nR# y# ref <1e5:3e5>\n.subckt V# in out com\nB1 in out I=if(V(out,com)<<1|1.5>,uramp(V(in,out))*<1e-5|1e-4>,0)\nC1 out com <1n|10n> mfg=\"KEMET\" pn=\"C0603\" type=\"X7R\" Lser=0 Rser=0\n.ends", "X# out y# ref V#\nR# y# ref <1e5:3e5>\n.subckt V# in out com\nS1 in out in com SW\n.model SW VSWITCH(RON=<10|1k> ROFF=<1e7|1e8> VON=<1|2> VOFF=<0.5|0.8>)\nC1 out com <1n|10n>\n.ends", "X# out ref V#\n.subckt V# k a\nS1 k m k a SW\nR1 m a <1e4:5e4>\n.model SW SW(Ron=1 Roff=100Meg Vt=<1|2> Vh=<0.2|0.4>)\n.ends", "X# out ref V#\n.subckt V# k a\nG1 k a TABLE {V(k,a)} = (0,0) (<1|2>,1u) (3,100u)\n.ends", "X# out ref V#\n.subckt V# k a\nB1 k a i=uramp(v(k,a)-<1:3>)*<1e-5|1e-4>\nR1 k a <1e6:1e7> tol=1 pwr=0.1\n.ends",
    # Op-amps and comparators as macromodels.
    "X# out m# y# V#\nR1# y# m# 100k\nR2# m# ref <2e4:1e5>\n.subckt V# p m o\nG1 ref0 x p m <0.1m|1m>\nR1 x ref0 <1e5|1e6>\nC1 x ref0 <1n|3n>\nE1 e ref0 x ref0 <1|10>\nRo e o <100|1k>\nV0 ref0 0 0\nD1 x vc DX\nVc vc ref0 <1|3>\nD2 ref0 x DX\n.model DX D(is=1e-14 rs=1)\n.ends", "X# out m# y# V#\nRf# y# m# 10k\nRg# m# ref <1e4:1e5>\n.SUBCKT V# 1 2 3 PARAMS: GBW=<1k|5k> AOL=<100|1k>\nRIN 1 2 1MEG\nE1 4 0 VALUE = { LIMIT(AOL*V(1,2),-<4|10>,5) }\nR1 4 5 1K\nC1 5 0 {AOL/(6.2832*GBW*1K)}\nE2 6 0 5 0 1\nR2 6 3 <100|50>\n.ENDS",
    "X# out m# y# V#\nRf# y# m# 10k\nRg# m# ref 1e4\n.SUBCKT V# 1 2 3\nEGND 99 0 POLY(2) (1,0) (2,0) 0 .5 .5\nG1 3 0 1 2 <1m|2m>\nR1 3 0 1k\n.ENDS", "X# p out y# V#\nR# y# ref <1e5:5e5>\n.subckt V# a b o\nB1 x ref1 V=<1|3>*tanh(<2|10>*(V(a)-V(b)))\nV1 ref1 0 0\nR1 x o <1k|10k>\nC1 o 0 <100p|1n>\n.ends", "X# a out y# V#\nR# y# ref <1e5:5e5>\n.subckt V# inp inm o\nB1 o 0 V = V(inp,inm) > <0.1|0.5> ? <3|2> : 0\n.ends", "X# p n y# V#\nR# y# ref <1e5:5e5>\n.subckt V# a b o\nE1 o b VALUE {IF(V(a,b)><1|2>,<2|3>,0)}\n.ends", "V# b# n <3|5>\nX# p n b# y# V#\nR# y# ref 1meg\n.SUBCKT V# 1 2 3 4\nQ1 5 1 6 QN\nQ2 4 2 6 QN\nR1 3 5 <1e5:3e5>\nR2 3 4 <1e5:3e5>\nR3 6 2 <1e5:5e5>\n.MODEL QN NPN(BF=<80|150> IS=8E-16 CJC=1p TF=1n)\n.ENDS",
]  # fmt: skip
SUFFIXES = ((12, "t"), (9, "g"), (6, "meg"), (3, "k"), (0, ""), (-3, "m"), (-6, "u"), (-9, "n"),
            (-12, "p"), (-15, "f"), (-18, "e-18"), (-21, "e-21"))  # fmt: skip


def spelt(draw, low, high):
    """A log-uniform number of three digits in one of SPICE's spellings."""
    value = float(f"{math.exp(draw.uniform(math.log(max(low, 1e-3 * high)), math.log(high))):.3g}")
    power, letter = next(each for each in SUFFIXES if value >= 0.999 * 10.0 ** each[0])
    digits = f"{value / 10.0**power:.4g}"
    whole, _, rest = digits.partition(".")
    unit = str(draw.choice(["", "", "", "ohm", "V", "Hz", "s"])) if letter else ""
    forms = [f"{value:g}", f"{value:.6E}", digits + letter, (digits + letter).upper(), digits + letter + unit,
             f"{value / 10.0 ** (power + 3):.6g}{dict(SUFFIXES).get(power + 3) or 'e' + str(power + 3)}"]  # fmt: skip
    if letter and rest and len(letter) == 1 and letter != "f":
        forms.append(f"{whole}{letter}{rest}")
    return str(draw.choice(forms))


def filled(draw, template, number):
    """A template's text: choices from the innermost, then numbers, then its own number."""
    text = template.replace("<DIODE>", DIODE).replace("#", str(number))
    while found := re.search(r"<([^<>\n]*[|:][^<>\n]*)>", text):
        if "|" in found[1]:
            new = str(draw.choice(found[1].split("|")))
        else:
            ends = [float(re.sub("u$", "e-6", each)) for each in found[1].split(":")]
            new = spelt(draw, *ends)
        text = text[: found.start()] + new + text[found.end() :]
    for word, pool in (("<FUNCTION>", FUNCTIONS), ("<CONSTANT>", CONSTANTS)):
        while word in text:
            text = text.replace(word, str(draw.choice(pool)), 1)
    return text.replace("$", str(draw.choice(["v(p,n)/20", "(v(p,n)/20)", "(v(a)-v(n))/20"])))


def load_text(seed, number, kind):
    """One load: `kind` "random", or "vendor" whose text has parts of a vendor's library."""
    draw = np.random.default_rng([seed, number, kind == "vendor"])
    pool, several = (VENDORS, 1) if kind == "vendor" else (PARTS, int(draw.integers(2, 5)))
    parts = [pool[number % len(pool)], *draw.choice(PARTS, several - 1)]
    lines = [filled(draw, each, k) for k, each in enumerate(parts, 1)]
    lines += [filled(draw, str(draw.choice(FRONTS)), 0), filled(draw, FRONT_DIODE, 0)]
    lines += [f"Rload out ref {spelt(draw, 5e4, 1e6)}", f"Cs out ref {spelt(draw, 1e-8, 2e-7)}"]
    dialect = str(draw.choice(["", "", "", "* dialect: ngspice\n", "* dialect: ltspice\n", "* dialect: pspice\n"]))
    return f"* {kind} {number} of {seed}\n{dialect}.subckt z p n out ref\n" + "\n".join(lines) + "\n.ends\n"
