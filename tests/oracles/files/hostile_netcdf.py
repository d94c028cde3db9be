"""Currents in netCDF-4 files whose values lie in another file, as HDF5 allows: by external storage
or external links.

Written by h5py 3.16, which the tests do not need; the other file's name stands in for 200 letters
@.
"""

import zlib
from base64 import b85decode
from pathlib import Path

import netCDF4
import numpy as np

ROOM = b"@" * 200
# f.create_dataset(name, shape=(2, 3, 4), dtype="<f4", external=[("@" * 200, 0, 96)]); f[name] =
# h5py.ExternalLink("@" * 200, name)
FILES = {
    "storage": (
        "c-rk+%}*0S6o0$hm8C6GKmk7z_E<F}Z9@!dj5KAjB&9SI4Y#tP8@dT>Np}l+lB3={di3a@;L#&Tj~x9oxZ!@hp*usjHKZ7e^GlPLnSC>}?_("
        "x!e%(*S<(0Ac{Wy3~6o^3z!Z=5qKB3#>`8G-c<wum?MA9$#&t|cI0_SJ-Ha9fQ(>`ZF*2%;InFfyk5k)Ou@#GfC2b3owt>>8gh9~!Q$8Ya7E"
        "nl{q!Sll=ov;1!Nr16H7YC#;e;ZRl`xoj-Ziag*6Y48a{GKIPNWj9m6g-#RUhlamivCOr?g&Xhb!Ois(Lw=kxe5vtO8IKlZBL;ldH?0rHLYA"
        "-T`$+Fg?veK$E9(c?2jww*EGO!a%dd!6S3!=9P}RpZRZ&}=qL79%j?VD+~jS~<lg=x`<^lH63_{tO1<?|a_&s@)+2G<n*KNQIqBv{IKFMmbZ"
        "jq9Zh+=OacVT%EnBrsYsXM?ncUO)Y<51EQM0+{nT-1j<;iV-9^28ay56eSEZq;VH(#tv+(}*+nY=FE8B|`U6ea_%Ew97&k$umu6ZY>|NWX6E"
        "whY6rS<RNypvFb}Q=!*0op#;m*mr>A$6b47Lw1x_tD6A#(9Rjmc|j1+&p=5b<T{CI$C$S4ubYmvH@xrnReL@gnU#w{Qo=KoFHpV=<nh}dK^x"
        "`q8*CHF!NI}7!ND;MAa!7csRPq@2UQ2A6}oc&OLZXL`+C)Z$u4!Eq1#R{Zn1A2I7+X#OBI3_{!LK#M}f>M1sx(&_aV&@+24u79QLU&qrl7u="
        "pKg=*IxoI?=dk4lk|Oy<#9T3BMi(orAP9kGJ^aK)34xtt8(dPN8jU58Q$pgB>g^1Hw2wL2>eRweUXVX!1p0PM`-)l`wYpClSee40PuAv?Taz"
        "{lGyj<@o?Iggks<G?m=k3dgtVk_uMx0+L7)Ut=gfn*W59k_c%}7*KG{w+`Hi2kcU2C-oM|uM+l*-o_p7EuODUFai*OZ*u6d)uM6uXA;ix~5q"
        "w;X=_kCO%%1Y8j&0rMiAT(nh?wUhPUE~*<KW=n;Nalk;Nalk;NZ9_qWD;q`7r9H@v%ubL3_u+fmztlR<sSRT+oounHB>IqOLo-Z8&}XNO+&R"
        "xo=puiT^%a=9^e}YY-maf1e0`nEl>~{jO<P?GYGzgdw*_WbEninZ5tF`4j&2VaPxJ_ewno*x%4nhk5"
    ),
    "link": (
        "c-rk(!A{#i5Z$$7YC@=jxKv#5kqfF5p(+JcB_ghZ1R=tu;ub7oK_qHRv5k7nvAy*(`WYO1;>@RTOLx69X4fR3f{Ik|Q>4+%?(BGW-Z<kQ?bf"
        "IH@=}>_m?kNaDv>b;Sc|HT>qj6d$nPM3X=tBK*WQ4=3g>rU3H>M7KkqvZ-#yL&<Jcu3O;X?`qU|)hTpogMf&8th`{Kb@pUX2ZPW7`eQ25#S%"
        "ea)3g)c>2Fqu+e!0;$_w$4`;tdGFeO|mve*2cP6H<*>LYnny{pT&7PMQW@4S0OgUonaeHvbEE6U8XO>PRy&dz3X(`?Y&OV-D>VQ%x?w!jMT5"
        "w+;s@}8Im8~7xv{hL)b^z6Q~{McJ^A7Wr<IDZQOl-*!Q`#ZULiM`pe*Rh4DhJYZ46Nh}VY|W?8DwX_yQnD;fmHzE!vD?^bKI)w*rf>g%@6ei"
        "A=kr{_em7xcYhzZZCEVflHb3H7GH!}b(j>lvRP%j>F{W5Pe<wVWsRe?E?U&-2p$zJD_G{iqj&!}wJ3n|`mR8gCFMeP7G+ocvE#hI>NHKx43;"
        "Vn^I`lWb?Nu<C7liI*~K7wq4o1)*Qihp@6CNJ-v<+yMDO$kCSzp@SS9fR3_2fdT~z6e#dN0O!E&lsOPSyEFOlIdH{PzucZ^4utQ&yXL^kggM"
        "anqFDGf?wtc?)p#fAAehZ-SHj=i)ROR$UDq=Kd7Ff}{LY_Oe&;;DKMAN5uK"
    ),
}


def write(path: Path, how: str, secret: Path) -> None:
    """Write a file of currents (uo, vo) whose values are those of another file; how: "storage" or
    "link".
    """
    content = zlib.decompress(b85decode(FILES[how]))
    path.write_bytes(content.replace(ROOM, str(secret).encode().rjust(len(ROOM), b"/")))


def secret(path: Path, how: str) -> None:
    """Write a file that such a name may lead to: values of 0.25, bare or in variables."""
    if how == "storage":
        path.write_bytes(np.full(24, 0.25, "<f4").tobytes())
        return
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("x", 24)
        for name in ("uo", "vo"):
            data.createVariable(name, "f4", ("x",))[:] = 0.25
