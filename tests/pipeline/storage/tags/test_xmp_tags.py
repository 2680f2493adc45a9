"""XMP packets as makers write them, and as nobody should."""

import pytest

from orthomill.pipeline.storage.tags.xmp_tags import xmp_tags

RDF = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'
PIX4D = 'xmlns:Camera="http://pix4d.com/camera/1.0"'


def packet(inner: str, head: str = "") -> str:
    return (
        f'<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>{head}<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF {RDF}>{inner}'
        '</rdf:RDF></x:xmpmeta>                  <?xpacket end="w"?>\0\0'
    )


def read(inner: str, head: str = "") -> dict[str, str]:
    return xmp_tags({"xml:XMP": packet(inner, head)})


def test_attributes_elements_lists_and_structures():
    assert read(f'<rdf:Description {DJI} drone-dji:RtkFlag="50"/>') == {"drone-dji:RtkFlag": "50"}
    assert read(f"<rdf:Description {DJI}><drone-dji:RtkFlag> 50\n</drone-dji:RtkFlag></rdf:Description>") == {
        "drone-dji:RtkFlag": "50"
    }
    items = "".join(f"<rdf:li>{word}</rdf:li>" for word in ("0.1", "-0.2"))
    seq = f"<Camera:PerspectiveDistortion><rdf:Seq>{items}</rdf:Seq></Camera:PerspectiveDistortion>"
    assert read(f"<rdf:Description {PIX4D}>{seq}</rdf:Description>") == {"Camera:PerspectiveDistortion": "0.1,-0.2"}
    struct = (
        '<rdf:Description xmlns:s="https://www.skydio.com/drone-skydio/1.0/"><s:CameraOrientationNED rdf:parseType="Resource">'
        "<s:Yaw>10</s:Yaw><s:Pitch>-90</s:Pitch></s:CameraOrientationNED></rdf:Description>"
    )
    names = (f"drone-skydio:CameraOrientationNED/drone-skydio:{name}" for name in ("Yaw", "Pitch"))
    assert read(struct) == dict(zip(names, ("10", "-90"), strict=True))


def test_the_namespace_decides_and_not_the_prefix():
    assert read('<rdf:Description xmlns:d="http://www.dji.com/drone-dji/1.0/" d:RtkFlag="50"/>') == {"drone-dji:RtkFlag": "50"}
    assert read('<rdf:Description xmlns:Camera="http://pix4d.com/camera/1.0/" Camera:Yaw="1"/>') == {"Camera:Yaw": "1"}
    foreign = read('<rdf:Description xmlns:drone-dji="http://example.org/x" drone-dji:RtkFlag="50"/>')
    assert "drone-dji:RtkFlag" not in foreign


def test_a_packet_that_was_divided_at_its_equals_sign_is_whole_again():
    key, _, value = packet(f'<rdf:Description {DJI} drone-dji:RtkFlag="50"/>').partition("=")
    assert key == "<?xpacket begin" and xmp_tags({key: value}) == {"drone-dji:RtkFlag": "50"}


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE x [<!ENTITY a "50">]>',
        '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE x SYSTEM "http://127.0.0.1/x.dtd">',
    ],
)
def test_entities_are_refused(head):
    value = "&a;" if "ENTITY" in head else "50"
    assert read(f'<rdf:Description {DJI} drone-dji:DewarpFlag="1" drone-dji:RtkFlag="{value}"/>', head) == {}


def test_what_stands_before_a_damaged_place_is_read():
    text = packet(f'<rdf:Description {DJI} drone-dji:RtkFlag="50"/>')
    assert xmp_tags({"xml:XMP": text[: text.index("/rdf:RDF")] + ">"}) == {"drone-dji:RtkFlag": "50"}
    assert xmp_tags({"xml:XMP": "no XML"}) == xmp_tags({"xml:XMP": ""}) == xmp_tags({}) == {}


def test_sizes_are_bounded():
    many = " ".join(f'drone-dji:T{i}="1"' for i in range(2000))
    assert len(read(f"<rdf:Description {DJI} {many}/>")) == 500
    assert read(f'<rdf:Description {DJI} drone-dji:A="{"x" * 3000}" drone-dji:B="1"/>') == {"drone-dji:B": "1"}
    assert read("<rdf:a>" * 50 + "</rdf:a>" * 50) == {}
    assert read(f'<rdf:Description {DJI} drone-dji:B="1"/>' + " " * 3_000_000) == {}
    listed = "<rdf:li>1234567</rdf:li>" * 2000
    assert (
        len(read(f"<rdf:Description {DJI}><drone-dji:C><rdf:Seq>{listed}</rdf:Seq></drone-dji:C></rdf:Description>")["drone-dji:C"])
        == 2000
    )
